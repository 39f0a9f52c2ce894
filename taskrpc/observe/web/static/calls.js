// Draws the calls live: lanes of clients, server, queue and robot; new calls appear at the right.

import { DRAWING, byId, calm, drawn, element, setAttribute, setStyle, setText, showEach } from "./dom.js";
import { Lanes } from "./lanes.js";
import { callText, endOf, meaning, milliseconds, plural, shortName, taskText } from "./words.js";

const WINDOW = 10; // seconds that the track shows
const REBASE = 10; // seconds until the drawing gets a new origin
const MOTION = 60; // seconds of one animation; longer than until the next origin
const DRIFT = 40; // milliseconds that the animation may differ from the clock
const BAR = 0.1875; // rem, the least length of a call
const LONG = 0.1; // seconds; a longer call is drawn as a thin bar, or it would hide the others
const QUIET = 40; // calls/s above which only notable calls have a line to the server
const NEAR = 8; // pixels around a call that still count as the call

/** Return whether a call gets its own mark. */
const isNotable = (call) => call.state !== "ok" || call.attempt > 1 || call.repeated;

/** Return the newest result of a lane, short enough for its end: the code is beside the call. */
const resultText = (call, now) => (call.state === "error" ? `✕ ${milliseconds(call.ms)}` : retryText(call) || callText(call, now));

const retryText = (call) => (call.attempt > 1 ? `retry ${call.attempt - 1}` : "");

const tone = (call) => (call.state === "error" ? "bad" : call.state === "open" ? "warn" : call.repeated ? "violet" : "good");

export class CallsView {
  constructor(model) {
    this.model = model;
    this.root = byId("calls");
    this.empty = element("div.empty#calls_empty", "No call in the last seconds.", element("span", "Each call appears here: from its client to the server, the queue and the robot."));
    this.lanes = new Lanes(this.root, "Calls of the last ten seconds; the tab List shows them as a table");
    this.bars = drawn("g");
    this.work = drawn("g");
    this.moving = drawn("svg.moving", DRAWING, this.bars, this.work);
    this.motion = null; // the animation that moves the drawing
    this.lanes.track.append(this.moving, this.empty);
    this.tooltip = byId("tooltip");
    this.origin = 0;
    this.open = new Map(); // id of an open call -> its mark
    this.latest = new Map(); // client -> its newest call
    this.lanes.track.addEventListener("pointermove", (event) => this.point(event));
    this.lanes.track.addEventListener("pointerleave", () => (this.tooltip.hidden = true));
    new ResizeObserver(() => this.resize()).observe(this.root);
  }

  get isShown() {
    return !this.root.hidden && !this.stopped;
  }

  resize() {
    const { track } = this.lanes;
    if (!this.lanes.resize(track.clientWidth, this.root.clientHeight)) return;
    this.redraw();
    if (!this.stopped) this.showLatest();
  }

  x(t) {
    return (t - this.origin) * this.pixels;
  }

  /** Draw all known calls again: after a change of size, of lanes or of origin. */
  redraw() {
    if (!this.lanes.ready) return;
    this.pixels = this.lanes.width / WINDOW;
    this.bar = BAR * this.lanes.rem;
    this.origin = this.model.now() - WINDOW;
    this.halt();
    this.moving.setAttribute("width", this.lanes.width * 2);
    this.moving.setAttribute("height", this.lanes.height);
    this.bars.replaceChildren();
    this.open.clear();
    this.labels = new Map(); // client -> x of the end of its newest label
    this.revision = this.lanes.revision;
    this.drawTasks();
    this.add([...this.model.calls.values()].filter((call) => endOf(call) > this.origin));
  }

  update(changed) {
    if (changed.has("reset")) {
      this.lanes.clear();
      this.latest.clear();
    }
    if (changed.has("calls")) {
      for (const call of this.model.new_calls) {
        this.lanes.see(call.client, call.begin + (call.ms ?? 0) / 1000);
        this.latest.set(call.client, call);
      }
      if (this.latest.size > 300) this.latest.clear();
    }
    if (!this.isShown || !this.lanes.ready) return;
    if (changed.has("reset") || this.revision !== this.lanes.revision) this.redraw();
    else {
      if (changed.has("calls")) this.add(this.model.new_calls);
      if (changed.has("tasks")) this.drawTasks();
    }
    if (changed.has("calls") || changed.has("tasks")) this.showLatest();
  }

  /** Add calls to the drawing; plain ones share one path, so that hundreds a second are cheap. */
  add(calls) {
    const marks = { link: [], long: [], plain: [], submission: [], queued: [] }; // class -> parts of its path
    for (const call of calls) {
      this.open.get(call.id)?.remove();
      this.open.delete(call.id);
      const x = this.x(call.begin);
      const y = this.lanes.y(call.client);
      const length = call.ms == null ? this.lanes.width * 2 : Math.max(this.bar, (call.ms / 1000) * this.pixels);
      if (isNotable(call)) this.addNotable(call, x, y, length);
      else {
        const isLong = call.ms > LONG * 1000;
        if (isLong) marks.long.push(`M${x.toFixed(1)} ${y}h${length.toFixed(1)}`);
        marks.plain.push(`M${(isLong ? x + length - this.bar : x).toFixed(1)} ${y}h${(isLong ? this.bar : length).toFixed(1)}`);
        if ((this.model.stats.per_second ?? 0) < QUIET) marks.link.push(`M${x.toFixed(1)} ${y}V${this.lanes.server}`);
      }
      if (!this.isSubmission(call)) continue;
      marks.submission.push(`M${x.toFixed(1)} ${y}V${this.lanes.queue}`);
      marks.queued.push(`M${x.toFixed(1)} ${this.lanes.queue}h0`); // the round end of a line is a dot
    }
    const batch = drawn("g", { "data-end": Math.max(...calls.map(endOf).filter(Number.isFinite)) });
    for (const [name, parts] of Object.entries(marks)) if (parts.length) batch.append(drawn(`path.${name}`, { d: parts.join("") }));
    if (batch.children.length) this.bars.append(batch);
    this.showEmpty();
  }

  /** Show a note if no call is drawn: each open call and each call in the window has a mark. */
  showEmpty() {
    this.empty.hidden = this.bars.childElementCount > 0;
  }

  isSubmission(call) {
    return this.lanes.fixed.length > 1 && call.task_id != null && call.state === "ok" && !call.repeated && call.service === this.model.service;
  }

  addNotable(call, x, y, length) {
    const thick = this.lanes.rem * 0.625;
    const mark = drawn("g.notable", { "data-tone": tone(call), "data-call": call.id, "data-end": endOf(call) },
      drawn("path.link", { d: `M${x} ${y}V${this.lanes.server}` }), drawn("rect", { x, y: y - thick / 2, width: length, height: thick, rx: 2 }));
    if (call.deadline_ms != null && (call.state === "open" || call.code === "DEADLINE_EXCEEDED")) {
      const limit = x + (call.deadline_ms / 1000) * this.pixels;
      mark.append(drawn("path.deadline", { d: `M${limit} ${y - thick / 2}v${1.5 * thick}` }));
    }
    const label = call.state === "error" ? `✕ ${call.code}` : [retryText(call), call.repeated && "stored response"].filter(Boolean).join(", ");
    if (label && this.hasRoom(call, x, label)) mark.append(drawn("text", { x, y: y - thick * 0.8 }, label));
    if (call.state === "open") this.open.set(call.id, mark);
    this.bars.append(mark);
  }

  /** Return whether a label fits into a client's lane without covering the one before it. */
  hasRoom(call, x, label) {
    if (!this.lanes.index.has(call.client) || x < (this.labels.get(call.client) ?? -Infinity)) return false;
    this.labels.set(call.client, x + label.length * this.lanes.rem * 0.5);
    return true;
  }

  /** Draw the tasks as bars in the robot's lane. */
  drawTasks() {
    const { tasks } = this.model;
    if (!tasks || !this.lanes.ready || !this.pixels) return;
    const thick = this.lanes.rem * 1.125;
    const list = [tasks.running, ...tasks.ended].filter((task) => task?.started && (task.ended ?? Infinity) > this.origin - WINDOW);
    const nodes = list.map((task) => {
      const begin = Math.max(task.started, this.origin - 2 * WINDOW);
      const x = this.x(begin);
      const width = task.ended ? Math.max(this.bar, this.x(task.ended) - x) : this.lanes.width * 3;
      const room = Math.floor(width / (this.lanes.rem * 0.45));
      const text = `task ${task.task_id} ${taskText(task)}`;
      return drawn("g.work", { "data-state": task.state },
        drawn("path.begins", { d: `M${x} ${this.lanes.queue}V${this.lanes.robot}` }),
        drawn("rect", { x, y: this.lanes.robot - thick / 2, width, height: thick, rx: 3 }),
        drawn("text", { x: x + 6, y: this.lanes.robot, "dominant-baseline": "central" }, text.length <= room ? text : room > 3 ? String(task.task_id) : ""));
    });
    this.work.replaceChildren(...nodes);
  }

  /** Show the newest call at the right end of each lane. */
  showLatest() {
    const now = this.model.now();
    const { tasks, stats, skipped } = this.model;
    this.lanes.clients.forEach(({ name }, i) => {
      const call = this.latest.get(name);
      if (call) this.lanes.last(i, shortName(call.service, this.model.service), resultText(call, now), tone(call));
    });
    if (this.lanes.others.size) this.lanes.last(this.lanes.clients.length, skipped ? `${plural(skipped, "call")} not drawn` : "");
    this.lanes.last(-this.lanes.fixed.length, stats.total ? `${plural(stats.total, "call")} in all` : "");
    if (this.lanes.fixed.length === 1) return;
    this.lanes.last(-2, tasks ? `${tasks.queued} queued` : "");
    if (tasks?.running) this.lanes.last(-1, `task ${tasks.running.task_id}`, taskText(tasks.running));
    else this.lanes.last(-1, "idle");
  }

  tick() {
    if (!this.isShown || !this.lanes.ready) return;
    const now = this.model.now();
    this.lanes.forget(now);
    const limit = now - WINDOW;
    for (const node of [...this.bars.children]) if (Number(node.dataset.end) < limit) node.remove();
    this.showEmpty();
    if (this.open.size) this.showLatest();
    if (now - this.origin > WINDOW + REBASE || now < this.origin) this.redraw();
  }

  /** Move the drawing. While the page is live, the browser does this without any further script. */
  frame(time) {
    if (!this.isShown || !this.lanes.ready) return;
    if (this.model.isMoving && !calm.matches) {
      const at = (time - this.origin) * 1000;
      this.motion ??= this.moving.animate([{ transform: this.place(0) }, { transform: this.place(MOTION) }], MOTION * 1000);
      if (Math.abs(this.motion.currentTime - at) > DRIFT) this.motion.currentTime = at;
      return;
    }
    this.halt();
    const now = calm.matches ? Math.floor(time) : time; // reduced motion: one step a second
    setStyle(this.moving, "transform", this.place(now - this.origin));
  }

  /** Return where the drawing is some seconds after its origin. */
  place(seconds) {
    return `translateX(${(this.lanes.width - seconds * this.pixels).toFixed(1)}px)`;
  }

  halt() {
    this.motion?.cancel();
    this.motion = null;
  }

  point(event) {
    if (this.stopped) return;
    const box = this.lanes.track.getBoundingClientRect();
    const t = this.model.now() - (box.right - event.clientX) / this.pixels;
    const y = event.clientY - box.top;
    let found = null;
    let nearest = NEAR / this.pixels;
    for (const call of this.model.calls.values()) {
      if (Math.abs(this.lanes.y(call.client) - y) > this.lanes.lane / 2) continue;
      const distance = Math.max(call.begin - t, t - endOf(call), 0);
      if (distance <= nearest) [found, nearest] = [call, distance];
    }
    this.tooltip.hidden = !found;
    if (!found) return;
    const lines = [`${found.client} → ${found.service}`, `${found.state === "ok" ? "ok, " : ""}${callText(found, this.model.now())}`, meaning(found.code), found.deadline_ms == null ? "no deadline" : `deadline ${milliseconds(found.deadline_ms)}`, found.task_id != null && `task ${found.task_id}`];
    setText(this.tooltip, lines.filter(Boolean).join("\n"));
    this.tooltip.style.transform = `translate(${Math.min(event.clientX, innerWidth - 280)}px, ${event.clientY - 16}px) translateY(-100%)`;
  }
}

const COLUMNS = ["time", "client", "service", "result", "latency", "deadline", "attempt", "task"];

/** The same calls as a table, newest first; it does not change while the user has scrolled down. */
export class CallList {
  constructor(model) {
    this.model = model;
    this.root = byId("list");
    this.body = element("tbody");
    this.table = element("table#call_table", element("caption.visually_hidden", "Newest calls"), element("thead", element("tr", ...COLUMNS.map((name) => element("th", { scope: "col" }, name)))), this.body);
    this.note = element("p.held", { hidden: true }, "New calls are not added while you read. Scroll to the top to see them.");
    this.empty = element("p.empty", "No call yet.");
    this.root.append(this.note, this.table, this.empty);
  }

  tick() {
    if (this.root.hidden) return;
    const calls = [...this.model.calls.values()];
    this.note.hidden = this.root.scrollTop < 4;
    this.empty.hidden = calls.length > 0;
    this.table.hidden = calls.length === 0;
    if (!this.note.hidden) return;
    const newest = calls.slice(-60).reverse();
    showEach(this.body, newest, () => element("tr", ...COLUMNS.map(() => element("td"))), (row, call) => this.show(row, call));
  }

  show(row, call) {
    setAttribute(row, "data-call", call.id);
    setAttribute(row, "data-tone", tone(call));
    const state = call.state === "ok" ? "✓ ok" : call.state === "open" ? "○ open" : `✕ ${call.code}`;
    const time = new Date(call.begin * 1000).toTimeString().slice(0, 8) + (call.begin % 1).toFixed(3).slice(1);
    const texts = [time, call.client, call.service, state, milliseconds(call.ms), milliseconds(call.deadline_ms), `${call.attempt}${call.repeated ? ", stored response" : ""}`, `${call.task_id ?? ""}`];
    texts.forEach((text, i) => setText(row.children[i], text));
  }
}
