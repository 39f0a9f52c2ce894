// Shows the state of the connection and the figures of the calls, and announces tasks that ended.

import { byId, element, icon, isProjector, root, setAttribute, setIcon, setText } from "./dom.js";
import { duration, milliseconds, stateOf, taskText, timeOfDay } from "./words.js";

const ANNOUNCE = 1500; // milliseconds between two announcements, so that a screen reader keeps up

const CONNECTION = {
  connecting: { word: "connecting", icon: "waiting" },
  live: { word: "live", icon: "live" },
  lost: { word: "connection lost", icon: "lost" },
  refused: { word: "refused", icon: "FAILED" },
  asleep: { word: "asleep", icon: "waiting" },
  recording: { word: "recording", icon: "recording" },
};

export class StatusView {
  constructor(model) {
    this.model = model;
    this.connection = byId("connection");
    this.connection.append(icon("waiting"), element("span"));
    this.banner = byId("banner");
    this.stats = Object.fromEntries([...document.querySelectorAll("[data-stat]")].map((node) => [node.dataset.stat, node]));
    this.pending = [];
    this.known = null; // ids of the ended tasks that were announced
    model.listeners.push((name, data) => name === "tasks" && this.noteEnds(data));
  }

  update(changed) {
    if (changed.has("hello")) {
      const { server, recording } = this.model.hello;
      setText(byId("service"), isProjector ? server.service : server.service && `${server.service} at ${server.address}${server.speed === 1 ? "" : ` · ${server.speed} × speed`}`);
      document.title = `${recording?.name ?? server.service} · taskrpc`;
    }
    if (changed.has("connection") || changed.has("hello")) this.showConnection();
    if (changed.has("calls") || changed.has("connection")) this.showStats();
  }

  tick() {
    if (this.model.connection.state !== "live") this.showConnection();
    const now = performance.now();
    if (!this.pending.length || now - (this.announced ?? -ANNOUNCE) < ANNOUNCE) return;
    this.announced = now;
    const text = this.pending.length > 3 ? `${this.pending.length} tasks ended. ${this.pending.at(-1)}` : this.pending.join(" ");
    setText(byId("announcements"), text);
    this.pending = [];
  }

  showConnection() {
    const { state, text, since, note } = this.model.connection;
    const { word, icon: symbol } = CONNECTION[state];
    setAttribute(this.connection, "data-state", state);
    setAttribute(root, "data-connection", state);
    setIcon(this.connection.firstChild, symbol);
    setText(this.connection.lastChild, note && state === "live" ? `${word} · ${note} at ${timeOfDay(this.model.hello.server.started)}` : word);
    const seconds = Date.now() / 1000 - since;
    let banner = "";
    if (state === "lost" && (seconds > 0.4 || !this.model.hello)) banner = `Connection lost since ${timeOfDay(since)} (${duration(Math.floor(seconds))}): ${text}. The page shows the state of that time, and reconnects by itself.`;
    if (state === "refused") banner = text;
    if (state === "recording") banner = this.model.hello.recording.problem;
    if (state === "asleep") banner = `This page has been asleep since ${timeOfDay(since)}, because its tab was hidden.`;
    setText(this.banner, banner);
    this.banner.hidden = !banner;
  }

  showStats() {
    const stats = this.model.isStale ? {} : this.model.stats; // a figure that does not change would look live
    const texts = { ...stats, per_second: stats.per_second?.toFixed(stats.per_second < 10 ? 1 : 0), p50_ms: milliseconds(stats.p50_ms), p99_ms: milliseconds(stats.p99_ms) };
    for (const [name, node] of Object.entries(this.stats)) setText(node, String(texts[name] ?? "–"));
    setText(this.stats.errors.previousElementSibling, stats.errors === 1 ? "error" : "errors");
    setAttribute(this.stats.errors, "data-tone", stats.errors ? "bad" : null);
  }

  noteEnds(tasks) {
    const ended = new Map(tasks.ended.map((task) => [`${task.task_id} ${task.ended}`, task]));
    if (this.known) for (const [key, task] of ended) if (!this.known.has(key)) this.pending.push(`Task ${task.task_id}, ${taskText(task)}: ${stateOf(task.state).word.toLowerCase()}.`);
    this.known = new Set(ended.keys());
  }
}
