// The state that the page shows. Views read it; only events change it.

import { endOf } from "./words.js";

const CALLS = 2000; // most calls that are kept
const CALL_AGE = 15; // seconds that an ended call is kept; longer than the lanes show
const POSES = 40; // most poses that are kept for the interpolation
const TRAIL = 400; // most points of the trail
const TRAIL_STEP = 0.05; // metres between two points of the trail
const DELAY = 0.15; // seconds that a recorded robot is drawn late, so that there is a next pose to move to

/** Return the shortest turn from one heading to another, in radians. */
export const turnBetween = (from, to) => Math.atan2(Math.sin(to - from), Math.cos(to - from));

/** An estimate of the server's clock, from the event with the least delay. */
class ServerClock {
  constructor() {
    this.offset = null; // seconds between the server's clock and performance.now()
    this.frozen = null;
  }

  observe(t) {
    const offset = t - performance.now() / 1000;
    // A delayed event gives a smaller offset. The slow decay follows a clock that drifts.
    this.offset = this.offset === null || offset > this.offset || this.offset - offset > 5 ? offset : this.offset - 0.0005;
    this.frozen = null;
  }

  thaw() {
    this.frozen = null;
  }

  freeze() {
    this.frozen ??= this.now();
  }

  now() {
    return this.frozen ?? performance.now() / 1000 + (this.offset ?? Date.now() / 1000 - performance.now() / 1000);
  }
}

/** Events whose data the model keeps unchanged, with their property. */
const PLAIN = { path: "path", scan: "scan", graph: "graph", fleet: "fleet", class: "students", frames: "frames" };
const NO_STATS = { per_second: null, p50_ms: null, p99_ms: null, errors: null, total: 0, open: null };

export class Model {
  constructor() {
    this.clock = new ServerClock();
    this.connection = { state: "connecting", text: "", since: Date.now() / 1000, note: "" };
    this.hello = null;
    this.changed = new Set(); // names of the events since the last frame, and "connection"
    this.listeners = []; // functions that get (name, data) when an event has been applied
    this.reset();
  }

  /** Forget all state except the `hello` event: after a restart, or a jump in a recording. */
  reset() {
    this.tasks = this.robot = this.scan = this.graph = this.fleet = this.students = this.scene = this.frames = null;
    this.tasks_at = 0; // the server's time of the newest `tasks` event; estimates count from it
    this.poses = [];
    this.trail = [];
    this.path = { task_id: null, points: [] };
    this.results = new Map(); // of ended tasks in a recording, by their ids
    this.calls = new Map(); // id -> call, oldest first
    this.new_calls = []; // calls of the events since the last frame
    this.skipped = 0; // calls that the server did not send
    this.stats = NO_STATS;
    for (const name of ["reset", "tasks", "robot", "path", "scan", "calls", "graph", "fleet", "class", "scene", "frames"]) this.changed.add(name);
  }

  now() {
    return this.clock.now();
  }

  /** The name of the task server's service. */
  get service() {
    return this.hello?.server.service;
  }

  get speed() {
    return this.hello?.server.speed ?? 1;
  }

  get canControl() {
    return Boolean(this.hello?.control) && this.connection.state === "live";
  }

  /** Whether the page shows the state of some time ago. */
  get isStale() {
    return ["lost", "asleep"].includes(this.connection.state);
  }

  /** Whether the drawing of the calls moves with the time. */
  get isMoving() {
    return this.connection.state === "live" && this.scene?.running !== false;
  }

  get isRecording() {
    return this.connection.state === "recording";
  }

  setConnection(state, text) {
    const since = state === this.connection.state ? this.connection.since : Date.now() / 1000;
    this.connection = { state, text, since, note: state === "live" ? this.connection.note : "" };
    if (state !== "live" && state !== "recording") this.clock.freeze();
    this.changed.add("connection");
  }

  /** Apply one event; `t` is the time of the event, now by default. */
  apply(name, data, t = null) {
    if (name in PLAIN) this[PLAIN[name]] = data;
    else this[`apply_${name}`]?.(data, t);
    this.changed.add(name);
    for (const listener of this.listeners) listener(name, data);
  }

  apply_hello(data) {
    const restarted = this.hello && this.hello.server.started !== data.server.started;
    this.hello = data;
    this.clock.offset = null;
    this.clock.observe(data.now);
    this.reset();
    if (restarted) this.connection.note = "restarted";
    this.changed.add("connection");
  }

  apply_tasks(data, t) {
    this.tasks = data;
    this.tasks_at = data.t ?? t ?? this.now();
  }

  apply_robot(data, t) {
    if (t === null) this.clock.observe(data.t);
    this.robot = data;
    const last = this.poses.at(-1);
    // After a rest, the robot must not move slowly through the whole rest.
    if (last && data.t - last.t > 0.5) this.poses.push({ ...last, t: data.t - 0.1 });
    this.poses.push(data);
    if (this.poses.length > POSES) this.poses.shift();
    const end = this.trail.at(-1);
    if (!end || Math.hypot(data.x - end[0], data.y - end[1]) > TRAIL_STEP) {
      this.trail.push([data.x, data.y]);
      if (this.trail.length > TRAIL) this.trail.shift();
    }
  }

  apply_scene(data) {
    if (data.number !== this.scene?.number) this.reset(); // the calls of earlier runs would have the same ids
    this.scene = data;
    if (data.running) this.clock.thaw();
    else this.clock.freeze(); // the calls of the run stay where they are while the class talks about them
  }

  apply_task(data) {
    this.results.set(data.task_id, data);
  }

  apply_calls(data, t) {
    for (const call of data.calls) {
      this.calls.delete(call.id); // a call that ends moves to the end
      this.calls.set(call.id, call);
      this.new_calls.push(call);
    }
    const oldest = (t ?? this.now()) - CALL_AGE;
    for (const [id, call] of this.calls) {
      if (this.calls.size > CALLS || endOf(call) < oldest) this.calls.delete(id);
      else if (call.state !== "open") break; // all later ones are newer
    }
    if (this.new_calls.length > CALLS) this.new_calls.splice(0, this.new_calls.length - CALLS);
    this.skipped += data.skipped;
    this.stats = data.stats;
  }

  /** Return the robot's pose now: the newest one, or in a recording between two; null before the first one. */
  pose() {
    const { poses } = this;
    if (!this.isRecording) return poses.at(-1) ?? null;
    const at = this.now() - DELAY;
    const i = poses.findIndex(({ t }) => t >= at);
    if (i < 1) return poses.at(i) ?? null;
    const [before, after] = poses.slice(i - 1);
    const share = Math.max(0, Math.min(1, (at - before.t) / (after.t - before.t)));
    return {
      x: before.x + share * (after.x - before.x),
      y: before.y + share * (after.y - before.y),
      theta: before.theta + share * turnBetween(before.theta, after.theta),
    };
  }

  /** Return the robot seconds until a task ends, counted down from its newest estimate. */
  timeLeft(task) {
    const runs = this.tasks.running?.state === "RUNNING" || (!this.tasks.paused && !this.tasks.running);
    return task.estimated_time - (runs ? (this.now() - this.tasks_at) * this.speed : 0);
  }

  /** Return the completed part of the running task now, 0 to 1. */
  progress(task) {
    if (!(task.estimated_time > 0)) return task.progress;
    const left = Math.max(0, Math.min(1, this.timeLeft(task) / task.estimated_time));
    return 1 - (1 - task.progress) * left;
  }
}
