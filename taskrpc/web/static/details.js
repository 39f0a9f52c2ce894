// The dialog of one task: its facts, its result, and why its estimate changed.

import { byId, drawn, element } from "./dom.js";
import { stateBadge } from "./tasks.js";
import { authorization } from "./connection.js";
import { difference, duration, taskText, timeOfDay } from "./words.js";

/** Return a scan as a small drawing, seen from above; the robot looks to the right. */
function scanDrawing(scan) {
  const most = Math.max(...scan.ranges.filter(Number.isFinite), 0.1);
  const points = scan.ranges.map((range, i) => {
    const angle = scan.angle_min + i * scan.angle_increment;
    const reach = (Number.isFinite(range) ? range : most) / most * 76;
    return `${(80 + reach * Math.cos(angle)).toFixed(1)},${(80 - reach * Math.sin(angle)).toFixed(1)}`;
  });
  return drawn("svg", { viewBox: "0 0 160 160", class: "scan_result", role: "img", "aria-label": `Scan: ${scan.ranges.length} ranges, the longest ${most.toFixed(1)} metres` },
    drawn("polygon", { class: "scan_area", points: points.join(" ") }),
    drawn("path", { class: "scan_hits", d: points.map((point) => `M${point}h0`).join("") }),
    drawn("path", { class: "robot_heading_small", d: "M90 80 74 73 78 80 74 87z" }));
}

function resultOf(result) {
  if (!result || typeof result !== "object") return null;
  const children = [];
  if (Array.isArray(result.ranges) && result.ranges.length) children.push(scanDrawing(result));
  const facts = Object.entries(result).filter(([, value]) => !Array.isArray(value) && typeof value !== "object");
  children.push(factList(facts.map(([name, value]) => [name.replaceAll("_", " "), typeof value === "number" ? String(Math.round(value * 1000) / 1000) : String(value)])));
  return element("section", { class: "result" }, element("h3", {}, "Result"), ...children);
}

function factList(facts) {
  return element("dl", { class: "facts" }, ...facts.filter(([, value]) => value).map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))));
}

function changesOf(task) {
  const changes = (task.changes ?? []).filter((change) => Math.abs(change.seconds) >= 0.05);
  const text = changes.length ? null : element("p", { class: "quiet" }, "The estimate did not change.");
  return element("section", {}, element("h3", {}, "Why the estimate changed"), text, element("ul", { class: "changes" }, ...changes.map((change) => element("li", { "data-tone": change.seconds > 0 ? "warn" : "good" }, element("strong", {}, difference(change.seconds)), ` ${change.cause}`))));
}

export class Details {
  constructor(model, act) {
    this.model = model;
    this.act = act;
    this.dialog = byId("task_dialog");
    this.token = "";
    this.dialog.addEventListener("click", (event) => event.target === this.dialog && this.dialog.close());
  }

  /** Open the dialog with the facts that the page has; then load the others from the server. */
  async open(id) {
    const { tasks } = this.model;
    const known = [tasks.running, ...tasks.queue, ...tasks.ended].find((task) => task?.task_id === id);
    if (known) this.show(known, null);
    else this.dialog.replaceChildren(element("p", {}, `task ${id}`));
    if (!this.dialog.open) this.dialog.showModal();
    if (this.model.hello.recording) {
      const result = known?.ended && this.model.results.get(id);
      if (result) this.show({ ...known, ...result }, true);
      return;
    }
    try {
      const response = await fetch(`/task/${id}`, { headers: authorization(this.token) });
      if (response.ok && this.dialog.open) this.show(await response.json(), true);
    } catch {
      // The dialog keeps its facts; the banner says that the connection is lost.
    }
  }

  show(task, complete) {
    const time = (t) => (t ? timeOfDay(t) : "");
    const close = element("button", { type: "button", class: "icon_button", "aria-label": "Close", onclick: () => this.dialog.close() }, "✕");
    const button = (label, verb, request) => element("button", { type: "button", onclick: () => { this.act(verb, request); this.dialog.close(); } }, label);
    const id = { task_id: task.task_id };
    const isOver = Boolean(task.ended);
    const buttons = !this.model.canControl ? [] : isOver ? (task.state === "SUCCEEDED" ? [] : [button("Queue it again", "requeue", { ...id, resume: false })]) : [button("Cancel the task", "cancel", id)];
    this.dialog.replaceChildren(
      element("header", {}, element("h2", { id: "task_title" }, `task ${task.task_id}  ${taskText(task)}`), close),
      stateBadge(task.state),
      task.message ? element("p", {}, task.message) : "",
      factList([["priority", String(task.priority)], ["client", task.client], ["submitted", time(task.submitted)], ["started", time(task.started)], ["ended", time(task.ended)], ["first estimate", duration(task.accepted_estimate)], [isOver ? "" : "ends in", isOver ? "" : duration(task.estimated_time)], ["took", isOver && task.started ? duration(task.ended - task.started) : ""]]),
      (complete && resultOf(task.result)) || "",
      complete ? changesOf(task) : "",
      element("footer", {}, ...buttons),
    );
  }
}
