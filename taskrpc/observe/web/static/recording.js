// Plays a recording: gives the model the events that a live stream has, and draws the time line.

import { authorization, partsOf } from "./connection.js";
import { DRAWING, byId, element, icon, root, setAttribute, setIcon, setText } from "./dom.js";
import { NotesView, momentText, noteText } from "./notes.js";
import { duration, timeOfDay } from "./words.js";

const SPEEDS = [0.1, 0.5, 1, 2, 5, 20];
const BACK = { robot: 40, calls: 12, task: Infinity }; // seconds of earlier events that a jump applies

/** Return the index of the first event after `t`. */
function after(events, t) {
  const found = events.findIndex((event) => event.t > t);
  return found < 0 ? events.length : found;
}

export class Recording {
  /** `calls` draws the lanes. */
  constructor(model, token, calls) {
    this.model = model;
    this.calls = calls;
    this.token = token;
    this.events = []; // {t, event, data}, in order of time
    this.named = {}; // the same events by their name
    this.next = 0; // index of the first event after the clock
    this.isPlaying = false;
    this.speed = 1;
    this.notes = null; // the view of a simulation's notes
    this.root = byId("timeline");
  }

  /** Read all events, then show the beginning. */
  async load() {
    const { recording, server } = this.model.hello;
    // Without a task server there are only calls.
    if (!server.service) Object.assign(root.dataset, { calls_only: "", part: "calls" });
    const response = await fetch("/recording", { headers: authorization(this.token) });
    if (!response.ok) throw new Error(`The recording cannot be read: HTTP status ${response.status}. Run taskrpc view again.`);
    for await (const line of partsOf(response.body, "\n")) {
      const event = JSON.parse(line);
      if (event.event === "hello") continue;
      this.events.push(event);
      (this.named[event.event] ??= []).push(event);
    }
    this.begin = recording.begin;
    this.end = Math.max(recording.end, this.begin + 0.001);
    // It runs from event to event at the chosen speed, and stops while paused.
    this.clock = this.model.clock = { t: this.begin, now: () => this.clock.t, observe() {}, freeze() {} };
    this.draw(recording.name);
    if (this.named.note) this.notes = new NotesView(this, this.calls);
    this.seek(this.begin);
    this.setPlaying(true);
  }

  draw(name) {
    const button = (id, symbol, label, act) => element("button.icon_button", { id, "aria-label": label, title: label, onclick: act }, icon(symbol));
    this.play = button("play", "RUNNING", "Play", () => this.setPlaying(!this.isPlaying));
    const scrub = () => this.seek(this.begin + (this.range.value / 1000) * (this.end - this.begin));
    this.range = element("input#scrub", { type: "range", min: 0, max: 1000, value: 0, step: "any", "aria-label": "Time in the recording", oninput: scrub });
    this.time = element("output#recording_time");
    const speeds = element("select#recording_speed", { "aria-label": "Playback speed", onchange: () => (this.speed = Number(speeds.value)) }, ...SPEEDS.map((speed) => element("option", { value: speed, selected: speed === 1 }, `${speed} ×`)));
    this.marks = element("div.marks", DRAWING);
    this.drawMarks();
    this.root.append(element("span.recording_name.minor", { title: name }, name), button("step_back", "back", "One event back", () => this.step(-1)), this.play, button("step_forward", "step", "One event forward", () => this.step(1)), element("div.range", this.range, this.marks), this.time, speeds);
    this.root.hidden = false;
  }

  /** Mark the errors, the ends of tasks, and the faults of a simulation on the time line, at most 300. */
  drawMarks() {
    const marks = new Map(); // place in per mille -> tone, or a note of a simulation
    let ended = null;
    for (const { t, event, data } of this.events) {
      const place = Math.round(((t - this.begin) / (this.end - this.begin)) * 300);
      const newest = event === "tasks" ? data.ended[0] : null;
      if (event === "calls" && data.calls.some((call) => call.state === "error")) marks.set(place, "bad");
      if (newest && ended !== null && newest.task_id !== ended && !marks.has(place)) marks.set(place, newest.state === "SUCCEEDED" ? "good" : "bad");
      if (event === "tasks") ended = newest?.task_id ?? 0;
      if (event === "note" && data.tone && marks.get(place)?.kind !== "failure") marks.set(place, { ...data, title: `${momentText(t - this.begin)}: ${noteText(data)}` });
    }
    for (const [place, found] of marks) {
      const { tone = found, kind, title } = found;
      const mark = element("span", { "data-tone": tone, "data-kind": kind, title });
      mark.style.left = `${place / 3}%`;
      if (kind) Object.assign(mark.style, { width: ".375rem", rotate: "45deg" });
      if (kind === "failure") Object.assign(mark.style, { height: "1rem", width: "3px", top: "-1rem", rotate: "none" });
      this.marks.append(mark);
    }
  }

  setPlaying(playing) {
    if (playing && this.clock.t >= this.end) this.seek(this.begin);
    this.isPlaying = playing;
    this.last = performance.now();
    setIcon(this.play.firstChild, playing ? "PAUSED" : "RUNNING");
    this.play.title = this.play.ariaLabel = playing ? "Pause" : "Play";
  }

  /** Pause at the next or the previous event; events with only a pose do not count. */
  step(by) {
    this.setPlaying(false);
    const isStop = ({ event, t }) => event !== "robot" && (by > 0 ? t > this.clock.t + 1e-6 : t < this.clock.t - 1e-6);
    const found = by > 0 ? this.events.find(isStop) : this.events.findLast(isStop);
    this.seek(found ? found.t : by > 0 ? this.end : this.begin);
  }

  /** Show the state at a time: for each name the newest event at or before it. */
  seek(t) {
    this.clock.t = Math.max(this.begin, Math.min(this.end, t));
    this.next = after(this.events, this.clock.t);
    this.model.reset();
    const chosen = [];
    for (const [name, events] of Object.entries(this.named)) {
      const end = after(events, this.clock.t);
      const begin = after(events, this.clock.t - (BACK[name] ?? 0));
      chosen.push(...events.slice(Math.max(0, Math.min(begin, end - 1)), end));
    }
    for (const { event, data, t: at } of chosen.sort((a, b) => a.t - b.t)) this.model.apply(event, data, at);
    this.showTime();
  }

  frame() {
    this.notes?.frame();
    if (!this.isPlaying) return;
    const now = performance.now();
    this.clock.t = Math.min(this.end, this.clock.t + ((now - this.last) / 1000) * this.speed);
    this.last = now;
    while (this.next < this.events.length && this.events[this.next].t <= this.clock.t) {
      const { event, data, t } = this.events[this.next++];
      this.model.apply(event, data, t);
    }
    this.showTime();
    if (this.clock.t >= this.end) this.setPlaying(false);
  }

  showTime() {
    const at = this.clock.t - this.begin;
    const whole = this.end - this.begin;
    if (document.activeElement !== this.range || this.isPlaying) this.range.value = (at / whole) * 1000;
    const text = `${duration(at)} of ${duration(whole)}`;
    setAttribute(this.range, "aria-valuetext", text);
    setText(this.time, `${timeOfDay(this.clock.t)}  ${text}`);
  }
}
