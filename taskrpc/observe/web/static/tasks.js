// Shows the tasks: the running one, the queue in the order in which it will run, and the ended ones.

import { APPEARS, animate, byId, calm, command, element, icon, isProjector, rem, root, setAttribute, setIcon, setStyle, setText } from "./dom.js";
import { Fitting } from "./fitting.js";
import { difference, duration, stateOf, taskText, timeOfDay, wholeSeconds } from "./words.js";

const ENDED_ROW = 2; // rem, the height of an ended task; as in style.css
const REASON = 3000; // milliseconds that a reason stays beside a task that moved
const EXAMPLE = "taskrpc-call /robot_task task_type=move target=warehouse priority=8";

/** Return a state as an icon with a word and a colour. */
export function stateBadge(state) {
  const badge = element("span.state", icon(state), element("span"));
  setBadge(badge, state);
  return badge;
}

function setBadge(badge, state) {
  const { word, tone } = stateOf(state);
  setAttribute(badge, "data-state", state);
  setAttribute(badge, "data-tone", tone);
  setIcon(badge.firstChild, state);
  setText(badge.lastChild, word);
}

/** The card of the running task. */
class NowView {
  constructor(model, open) {
    this.model = model;
    this.root = byId("now");
    this.badge = stateBadge("RUNNING");
    this.title = element("button.link#now_title", { onclick: () => open(this.model.tasks.running.task_id) }, element("span.now_id"), element("span"));
    this.facts = element("p.quiet#now_facts");
    this.bar = element("div#now_bar", { role: "progressbar", "aria-label": "Progress of the running task", "aria-valuemin": 0, "aria-valuemax": 100 });
    this.text = element("p#now_text");
    this.card = element("div.now_card", element("div.now_head", this.badge, this.title, this.facts), element("div.now_progress", this.bar, this.text));
    this.idle = element("div#idle", element("span.state", { "data-tone": "quiet" }, icon("QUEUED"), "Idle"), element("p.quiet"));
    this.root.append(this.card, this.idle);
  }

  update() {
    const { tasks } = this.model;
    const task = tasks?.running;
    this.card.hidden = !task;
    this.idle.hidden = Boolean(task);
    if (this.root.dataset.task !== String(task?.task_id)) {
      this.fill = element("div"); // a new one, because the old one would slide back from the end
      this.bar.replaceChildren(this.fill);
    }
    setAttribute(this.root, "data-task", task?.task_id);
    if (!task) {
      const text = !tasks ? "Waiting for the server." : tasks.paused ? "The queue is paused: no task begins until it is resumed." : "The robot has no task.";
      return setText(this.idle.lastChild, text);
    }
    setBadge(this.badge, task.state);
    setText(this.title.firstChild, `task ${task.task_id} `);
    setText(this.title.lastChild, taskText(task));
    setText(this.facts, [`priority ${task.priority}`, task.client, task.message].filter(Boolean).join(" · "));
    this.frame();
  }

  frame() {
    const task = this.model.tasks?.running;
    if (!task) return;
    const share = this.model.progress(task);
    const percent = Math.floor(share * 100);
    setStyle(this.fill, "transform", `scaleX(${share.toFixed(3)})`);
    setAttribute(this.bar, "aria-valuenow", percent);
    const left = this.model.timeLeft(task);
    const unit = this.model.speed === 1 || isProjector ? "" : " of robot time";
    const rest = task.state === "RUNNING" ? `done in ${wholeSeconds(left)}${unit}` : task.state === "PAUSED" ? `${wholeSeconds(left)} of work left` : "the robot is about to halt";
    setText(this.text, `${percent} %   ${rest}`);
  }
}

/** One queued task: a row of the grid, which keeps its elements while the task waits. */
class Row {
  constructor(view, task) {
    this.task = task;
    const cell = (name, ...parts) => element(`span.${name}`, { role: "gridcell" }, ...parts);
    this.place = cell("place");
    this.what = cell("what");
    this.priority = element("span.priority_value");
    this.client = cell("client");
    this.estimate = cell("estimate");
    this.reason = element("span.reason");
    const button = (verb, symbol, words) => {
      const title = `${words} task ${task.task_id}`;
      return element("button.row_button", { tabindex: -1, "data-verb": verb, "aria-label": title, title }, icon(symbol));
    };
    this.up = button("raise", "up", "Raise the priority of");
    this.down = button("lower", "down", "Lower the priority of");
    const cancel = button("cancel", "FAILED", "Cancel");
    this.node = element("div.row", { role: "row", tabindex: -1, "data-task": task.task_id, "data-state": task.state },
      this.place, cell("priority", this.priority, element("span.row_buttons", this.up, this.down)), cell("task_id", `task ${task.task_id}`),
      this.what, this.client, this.estimate, cell("row_cancel.row_buttons", cancel), this.reason);
    this.show(task, 0);
  }

  show(task, index) {
    this.task = task;
    this.index = index;
    setText(this.place, task.started ? "▶" : String(index + 1));
    setText(this.what, taskText(task));
    setText(this.priority, String(task.priority));
    setText(this.client, task.robot ? `${task.robot} ← ${task.client}` : task.client); // the start stays visible
    setAttribute(this.node, "data-priority", task.priority);
    this.up.disabled = task.priority >= 10;
    this.down.disabled = task.priority <= 1;
    setAttribute(this.estimate, "title", `first estimate ${duration(task.accepted_estimate)}`);
  }

  explain(move) {
    setText(this.reason, `${difference(move.seconds)}: ${move.cause}`);
    setAttribute(this.reason, "data-tone", move.seconds > 0 ? "warn" : "good");
    this.reason.classList.add("shown");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.reason.classList.remove("shown"), REASON);
  }
}

/** Return the priority that brings a task nearest to a place of the queue; 0 is the first place. */
export function priorityAt(queue, task, place) {
  const others = queue.filter((each) => each !== task);
  const landing = (priority) => others.filter((each) => each.priority > priority || (each.priority === priority && each.submitted < task.submitted)).length;
  const cost = (priority) => Math.abs(landing(priority) - place) + Math.abs(priority - task.priority) / 100;
  return [1, 2, 3, 4, 5, 6, 7, 8, 9, 10].reduce((best, priority) => (cost(priority) < cost(best) ? priority : best));
}

/** The queue as a grid: one row a task, moved by arrow keys and by the server. */
class QueueView {
  constructor(model, open, act) {
    this.model = model;
    this.root = byId("queue");
    this.fitting = new Fitting(this.root, byId("queue_more"), () => parseFloat(getComputedStyle(root).getPropertyValue("--row")));
    this.head = byId("next_text");
    this.empty = byId("queue_empty");
    this.rows = new Map(); // task_id -> Row
    this.dropped = false; // whether the mouse has just dropped a row
    this.explained = -Infinity; // the server's time of the newest reason that was shown
    this.empty.append(element("p"), command(EXAMPLE));
    this.root.addEventListener("click", (event) => this.clicked(event, open, act));
    this.root.addEventListener("pointerdown", (event) => this.grabbed(event, act));
    this.root.addEventListener("focusin", (event) => this.focused(event.target.closest(".row")));
  }

  /** Let the mouse drag a row to another place: this changes the priority of its task. */
  grabbed(event, act) {
    const node = event.target.closest(".row");
    if (!node || event.button || event.pointerType !== "mouse" || event.target.closest("button") || !this.model.canControl) return;
    const row = this.rowOf(node);
    const stop = new AbortController();
    let priority = null;
    const move = ({ clientY }) => {
      const by = clientY - event.clientY;
      if (priority === null && Math.abs(by) < 6) return;
      const place = Math.max(0, Math.min(this.rows.size - 1, row.index + Math.round(by / this.rowHeight)));
      priority = priorityAt(this.model.tasks.queue, row.task, place);
      node.classList.add("dragged");
      node.style.transform = `translateY(${by}px)`;
      setText(row.priority, String(priority));
    };
    const drop = () => {
      stop.abort();
      node.classList.remove("dragged");
      node.style.transform = "";
      if (priority === null) return;
      this.dropped = true; // the click event that follows must not open the details
      setText(row.priority, String(row.task.priority));
      if (priority !== row.task.priority) act("reprioritise", { task_id: row.task.task_id, priority });
    };
    addEventListener("pointermove", move, { signal: stop.signal });
    for (const name of ["pointerup", "pointercancel"]) addEventListener(name, drop, { signal: stop.signal });
  }

  clicked(event, open, act) {
    const wasDropped = this.dropped;
    this.dropped = false;
    if (wasDropped) return;
    const row = event.target.closest(".row");
    const task = this.rowOf(row)?.task;
    if (!task) return;
    const verb = event.target.closest("[data-verb]")?.dataset.verb;
    row.focus({ preventScroll: true });
    if (verb === "cancel") act("cancel", { task_id: task.task_id });
    else if (verb) act("reprioritise", { task_id: task.task_id, priority: task.priority + (verb === "raise" ? 1 : -1) });
    else open(task.task_id);
  }

  focused(row) {
    if (!row) return;
    this.current = Number(row.dataset.task);
    for (const each of this.root.children) each.tabIndex = each === row ? 0 : -1;
  }

  focusedRow() {
    return document.activeElement?.closest("#queue .row");
  }

  /** Return the Row of an element, undefined without one. */
  rowOf(node) {
    return this.rows.get(Number(node?.dataset.task));
  }

  /** Return the task of the focused row, null without one. */
  selected() {
    return this.rowOf(this.focusedRow())?.task ?? null;
  }

  /** Move the focus by some rows; from outside it goes to the first row. */
  step(by) {
    const nodes = [...this.root.children];
    const at = nodes.indexOf(this.focusedRow());
    const next = nodes[at < 0 ? 0 : Math.max(0, Math.min(nodes.length - 1, at + by))];
    if (next?.hidden) this.fitting.showAll(true);
    next?.focus();
  }

  update(changed) {
    const { tasks } = this.model;
    const queue = tasks?.queue ?? [];
    this.root.hidden = !queue.length;
    this.empty.hidden = queue.length || !tasks;
    setText(this.empty.firstChild, this.model.isRecording ? "No task waits." : "No task waits. Try:");
    this.empty.lastChild.hidden = this.model.isRecording;
    setText(this.head, queue.length ? `${tasks.queued} queued${tasks.paused ? ", paused" : ""}${this.model.speed === 1 ? "" : ", times in robot seconds"}` : "");
    this.arrange(queue, changed.has("reset"));
    this.fitting.update(tasks?.more ?? 0);
    if (tasks) this.explain(tasks.moves, changed.has("reset"));
    this.frame();
  }

  /** Bring the rows into the order of the queue; rows slide from their old places. */
  arrange(queue, fresh) {
    const focus = this.focusedRow();
    const height = this.rowHeight ?? 0;
    const wanted = new Set(queue.map((task) => task.task_id));
    for (const [id, row] of this.rows) {
      if (wanted.has(id)) continue;
      row.node.remove();
      this.rows.delete(id);
    }
    let at = this.root.firstChild;
    queue.forEach((task, index) => {
      let row = this.rows.get(task.task_id);
      const isNew = !row;
      if (isNew) this.rows.set(task.task_id, (row = new Row(this, task)));
      const old = row.index;
      row.show(task, index);
      if (row.node === at) at = at.nextSibling;
      else this.root.insertBefore(row.node, at);
      if (fresh || calm.matches) return;
      if (isNew) animate(row.node, APPEARS);
      else if (old !== index && height) animate(row.node, [{ transform: `translateY(${(old - index) * height}px)` }, { transform: "none" }], 220);
    });
    if (focus?.isConnected && document.activeElement !== focus) focus.focus({ preventScroll: true });
    const current = this.rows.get(this.current)?.node ?? this.root.firstChild;
    if (current && current.tabIndex !== 0) this.focused(current);
  }

  explain(moves, fresh) {
    const known = this.explained; // all moves of one cause have the same time
    for (const move of [...moves].reverse()) {
      if (move.t <= known) continue;
      this.explained = Math.max(this.explained, move.t);
      // After a reconnection, or a jump in a recording, the reasons are old: do not show them.
      if (fresh || this.model.now() - move.t >= REASON / 1000) continue;
      this.rows.get(move.task_id)?.explain(move);
    }
    if (fresh) this.explained = moves[0]?.t ?? -Infinity;
  }

  frame() {
    for (const row of this.rows.values()) setText(row.estimate, duration(this.model.timeLeft(row.task)));
  }
}

/** The ended tasks, newest first, with a count of each state. */
class DoneView {
  constructor(model, open) {
    this.model = model;
    this.root = byId("ended");
    this.counts = byId("done_counts");
    this.fitting = new Fitting(this.root, byId("ended_more"), () => ENDED_ROW);
    this.nodes = new Map(); // task_id and end -> element
    this.root.addEventListener("click", (event) => {
      const id = event.target.closest("[data-task]")?.dataset.task;
      if (id) open(Number(id));
    });
  }

  update(changed) {
    const { tasks } = this.model;
    const counts = Object.entries(tasks?.counts ?? {}).filter(([, n]) => n > 0);
    this.counts.replaceChildren(
      ...counts.map(([state, n]) => {
        const { word, tone } = stateOf(state);
        return element("span.state", { "data-tone": tone, title: word }, icon(state), String(n), element("span.count_word", word.toLowerCase()));
      }),
    );
    if (!counts.length) this.counts.append(element("span.quiet", "no task has ended yet"));
    const nodes = (tasks?.ended ?? []).map((task) => this.node(task, changed.has("reset")));
    this.nodes = new Map(nodes.map((node) => [node.dataset.key, node]));
    nodes.forEach((node, i) => this.root.children[i] !== node && this.root.insertBefore(node, this.root.children[i] ?? null));
    while (this.root.children.length > nodes.length) this.root.lastChild.remove();
    this.fitting.update(0);
  }

  node(task, fresh) {
    const key = `${task.task_id} ${task.ended} ${task.state}`;
    const known = this.nodes.get(key);
    if (known) return known;
    const node = element("li", { "data-task": task.task_id, "data-state": task.state, "data-key": key },
      stateBadge(task.state),
      element("button.link", `task ${task.task_id}  ${taskText(task)}`),
      element("span.quiet.ended_message", task.message),
      element("span.quiet.client", task.client),
      element("time.quiet", task.ended ? timeOfDay(task.ended) : ""));
    if (!fresh) animate(node, APPEARS);
    return node;
  }
}

/** The whole panel of the tasks. */
export class TasksView {
  constructor(model, open, act) {
    this.now = new NowView(model, open);
    this.queue = new QueueView(model, open, act);
    this.done = new DoneView(model, open);
    new ResizeObserver(([entry]) => {
      this.queue.rowHeight = parseFloat(getComputedStyle(root).getPropertyValue("--row")) * rem();
      if (!this.chosen) byId("done").open = entry.contentRect.height > 34 * rem();
    }).observe(byId("tasks_panel"));
    byId("done").firstElementChild.onclick = () => (this.chosen = true);
  }

  update(changed) {
    if (!changed.has("tasks")) return;
    this.now.update();
    this.queue.update(changed);
    this.done.update(changed);
  }

  /** Update the times that count down; a few times a second is enough. */
  tick() {
    this.queue.frame();
  }

  frame() {
    this.now.frame();
  }
}
