// Plays calls message by message, because a call takes less than a millisecond.

import { APPEARS, DRAWING, animate, byId, calm, drawn, setAttribute, setText } from "./dom.js";
import { QUEUE, ROBOT, SERVER } from "./lanes.js";
import { callText, meaning, milliseconds, plural, shortName, taskText } from "./words.js";

const PERIOD = 0.9; // seconds that each message takes at least
const BACKLOG = 24; // most messages that wait; further calls are skipped
const STEP = 11; // rem between two messages
const KEPT = 16; // messages that stay in the drawing
const TRAVEL = 700; // milliseconds that a message travels
const FIXED = [SERVER, QUEUE, ROBOT]; // the other ends of messages are clients

/** Return the messages of one call that has ended, in order: who sends what to whom. */
export function messagesOf(call, service) {
  const { client } = call;
  const name = call.service;
  const messages = [];
  const retry = call.attempt > 1 ? `retry ${call.attempt - 1}: ` : "";
  if (call.attempt > 1) messages.push({ from: client, to: SERVER, lost: true, label: "no response", text: `${client} got no response to its attempt ${call.attempt - 1}, and sends the request again.` });
  messages.push({ from: client, to: SERVER, label: retry + shortName(name, service), text: `${client} sends a request to ${name}${call.deadline_ms == null ? "" : `, with ${milliseconds(call.deadline_ms)} until its deadline`}.` });
  if (call.code === "DEADLINE_EXCEEDED") {
    messages.push({ from: SERVER, to: client, lost: true, tone: "bad", label: "deadline exceeded", text: `No response within ${milliseconds(call.deadline_ms ?? call.ms)}: the call ends with DEADLINE_EXCEEDED.` });
    return messages;
  }
  const isSubmission = call.task_id != null && name === service && call.state === "ok";
  if (isSubmission && !call.repeated) messages.push({ from: SERVER, to: QUEUE, label: `task ${call.task_id}`, text: `The server puts task ${call.task_id} into the queue.` });
  if (call.state === "error") messages.push({ from: SERVER, to: client, tone: "bad", label: call.code, text: `The server responds with the error ${call.code}: ${meaning(call.code) || "the call failed"}.` });
  else messages.push({ from: SERVER, to: client, tone: call.repeated ? "violet" : "good", label: callText(call, 0), text: call.repeated ? `The server knows this request: it sends the stored response, and does not execute the request again.` : `The server responds after ${milliseconds(call.ms)}.` });
  return messages;
}

export class SlowMotion {
  /** `calls` is the live view: both share the panel and its lanes. */
  constructor(model, calls) {
    this.model = model;
    this.calls = calls;
    this.lanes = calls.lanes;
    this.drawing = drawn("g");
    this.svg = drawn("svg.slow", DRAWING, { hidden: true }, drawn("defs", drawn("marker#head", { viewBox: "0 0 8 8", refX: 7, refY: 4, markerWidth: 7, markerHeight: 7, orient: "auto-start-reverse" }, drawn("path", { d: "M0 .5 8 4 0 7.5z", fill: "context-stroke" }))), this.drawing);
    this.lanes.track.append(this.svg);
    this.text = byId("message_text");
    this.backlog = [];
    this.mode = "live"; // live, playing or stepping
    this.running = model.tasks?.running; // the task that the robot executed at the last event
    this.model.listeners.push((name, data) => name === "tasks" && this.noteTasks(data));
    this.clear();
  }

  clear() {
    this.shown = []; // messages of the drawing, oldest first
    this.count = 0; // messages played so far
    this.skipped = 0;
    this.due = 0;
    this.drawing.replaceChildren();
  }

  setMode(mode) {
    if (mode === this.mode) return;
    const wasLive = this.mode === "live";
    this.mode = mode;
    this.calls.stopped = mode !== "live";
    this.svg.toggleAttribute("hidden", mode === "live");
    this.calls.moving.toggleAttribute("hidden", mode !== "live");
    setAttribute(this.lanes.frame, "data-mode", mode);
    this.calls.resize(); // in slow motion the track is wider
    setAttribute(this.text, "aria-live", mode === "stepping" ? "polite" : "off");
    if (mode === "live") {
      this.backlog = [];
      setText(this.text, "");
      this.calls.showLatest();
    } else if (wasLive) {
      this.clear();
      const ended = [...this.model.calls.values()].filter((call) => call.state !== "open");
      for (const call of ended.slice(-3)) this.backlog.push(...this.messages(call));
      setText(this.text, this.backlog.length ? "" : "Waiting for a call.");
    }
  }

  update(changed) {
    if (this.mode === "live" || !changed.has("calls")) return;
    // Show all messages of a call or none: a part would be misleading.
    const ended = this.model.new_calls.filter((call) => call.state !== "open");
    for (const call of ended) {
      const messages = this.messages(call);
      if (this.backlog.length + messages.length <= BACKLOG) this.backlog.push(...messages);
      else this.skipped += messages.length;
    }
  }

  /** Return the messages of a call between the lanes that there are. */
  messages(call) {
    return messagesOf(call, this.model.service).filter(({ to }) => !FIXED.includes(to) || this.lanes.fixed.includes(to));
  }

  noteTasks(tasks) {
    const before = this.running;
    const task = tasks.running;
    this.running = task;
    if (this.mode === "live" || task?.task_id === before?.task_id) return;
    if (before) {
      const ended = tasks.ended.find((each) => each.task_id === before.task_id);
      const state = (ended?.state ?? "ended").toLowerCase();
      this.backlog.push({ from: ROBOT, to: QUEUE, tone: state === "succeeded" ? "good" : "bad", label: `task ${before.task_id} ${state}`, text: `The robot ends task ${before.task_id}: ${state}${ended?.message ? `, ${ended.message}` : ""}.` });
    }
    if (task) this.backlog.push({ from: QUEUE, to: ROBOT, label: `task ${task.task_id}`, text: `The robot begins task ${task.task_id}: ${taskText(task)}.` });
  }

  /** Play the next message now; in slow motion, also stop playing. */
  step() {
    this.setMode("stepping");
    if (!this.next()) setText(this.text, "No message waits. The next call appears here.");
  }

  next() {
    const message = this.backlog.shift();
    if (!message) return false;
    message.step = this.count++;
    for (const end of [message.from, message.to]) if (!FIXED.includes(end)) this.lanes.see(end, this.model.now());
    this.shown.push(message);
    if (this.shown.length > KEPT) this.shown.shift();
    const more = this.backlog.length ? `  (${plural(this.backlog.length, "more message")}${this.skipped ? `, ${this.skipped} skipped` : ""})` : "";
    setText(this.text, message.text + more);
    this.draw(message);
    return true;
  }

  frame() {
    if (this.mode !== "playing") return;
    const now = performance.now() / 1000;
    if (now < this.due) return;
    if (this.next()) this.due = now + PERIOD;
  }

  y(end) {
    return FIXED.includes(end) ? this.lanes[end] : this.lanes.y(end);
  }

  draw(newest) {
    if (!this.lanes.ready) return;
    const steps = Math.max(2, Math.floor(this.lanes.width / (STEP * this.lanes.rem)));
    const width = this.lanes.width / steps;
    this.drawing.replaceChildren(...this.shown.map((message) => this.arrow(message, width, message === newest)));
    this.drawing.style.transform = `translateX(${-Math.max(0, this.count - steps) * width}px)`;
  }

  arrow(message, width, isNewest) {
    const x = message.step * width + 8;
    const from = this.y(message.from);
    const to = this.y(message.to);
    const share = message.lost ? 0.55 : 1;
    const end = [x + (width - 24) * share, from + (to - from) * share];
    const line = drawn("line", { x1: x, y1: from, x2: end[0], y2: end[1], "marker-end": message.lost ? null : "url(#head)" });
    const up = to < from;
    // Beside the upper end of the arrow there is room on both sides.
    const label = drawn("text", { x: (x + end[0]) / 2 + (up ? -4 : 4), y: (from + end[1]) / 2 - 6, "text-anchor": up ? "end" : "start" }, message.label);
    const group = drawn(`g.message${message.lost ? ".lost" : ""}${isNewest ? ".newest" : ""}`, { "data-tone": message.tone ?? "accent" }, line, drawn("circle", { cx: x, cy: from, r: 3 }));
    if (message.lost) group.append(drawn("path", { d: `M${end[0] - 5} ${end[1] - 5}l10 10m0-10l-10 10` }));
    group.append(label);
    if (isNewest && !calm.matches) this.travel(group, line, x, from, end);
    return group;
  }

  /** Let the message travel along its arrow. */
  travel(group, line, x, y, end) {
    const length = Math.hypot(end[0] - x, end[1] - y);
    const dot = drawn("circle.travels", { r: 5 });
    const head = line.getAttribute("marker-end");
    line.removeAttribute("marker-end"); // the head appears when the message arrives
    group.prepend(dot);
    animate(line, [{ strokeDasharray: `0 ${length}` }, { strokeDasharray: `${length} 0` }], TRAVEL);
    animate(dot, [{ transform: `translate(${x}px, ${y}px)` }, { transform: `translate(${end[0]}px, ${end[1]}px)` }], TRAVEL).onfinish = () => {
      dot.remove();
      if (head) line.setAttribute("marker-end", head);
    };
    animate(group.lastChild, APPEARS, TRAVEL);
  }
}
