// The dialog of one task: its facts, its result, and why its estimate changed.

import { byId, dialogHead, drawn, element } from "./dom.js";
import { scanShapes } from "./map.js";
import { stateBadge } from "./tasks.js";
import { authorization } from "./connection.js";
import { difference, duration, taskText, timeOfDay } from "./words.js";

/** Return a scan as a small drawing, seen from above; the robot looks to the right. */
function scanDrawing(scan) {
  const most = Math.max(...scan.ranges.filter(Number.isFinite), 0.1);
  const at = ([x, y]) => [80 + (x / most) * 76, 80 - (y / most) * 76];
  return drawn("svg.scan_result", { viewBox: "0 0 160 160", role: "img", "aria-label": `Scan: ${scan.ranges.length} ranges, the longest ${most.toFixed(1)} metres` },
    ...scanShapes({ ...scan, x: 0, y: 0, theta: 0, range_max: most }, at),
    drawn("path.robot_heading", { d: "M90 80 74 73 78 80 74 87z" }));
}

function resultOf(result) {
  if (!result || typeof result !== "object") return null;
  const facts = Object.entries(result).filter(([, value]) => typeof value !== "object");
  const text = (value) => String(typeof value === "number" ? Math.round(value * 1000) / 1000 : value);
  return element("section.result", element("h3", "Result"), Array.isArray(result.ranges) ? scanDrawing(result) : null, factList(facts.map(([name, value]) => [name.replaceAll("_", " "), text(value)])));
}

function factList(facts) {
  return element("dl.facts", ...facts.filter(([, value]) => value).map(([name, value]) => element("div", element("dt", name), element("dd", value))));
}

function changesOf(task) {
  const changes = (task.changes ?? []).filter((change) => Math.abs(change.seconds) >= 0.05);
  const text = changes.length ? null : element("p.quiet", "The estimate did not change.");
  return element("section", element("h3", "Why the estimate changed"), text, element("ul.changes", ...changes.map((change) => element("li", { "data-tone": change.seconds > 0 ? "warn" : "good" }, element("strong", difference(change.seconds)), ` ${change.cause}`))));
}

export class Details {
  constructor(model, act) {
    this.model = model;
    this.act = act;
    this.dialog = byId("task_dialog");
    this.token = "";
  }

  /** Open the dialog with the facts that the page has; then load the others from the server. */
  async open(id) {
    const { tasks } = this.model;
    const known = [tasks.running, ...tasks.queue, ...tasks.ended].find((task) => task?.task_id === id);
    if (known) this.show(known, null);
    else this.dialog.replaceChildren(element("p", `task ${id}`));
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
    const { task_id } = task;
    const isOver = Boolean(task.ended);
    const press = () => {
      this.act(isOver ? "requeue" : "cancel", isOver ? { task_id, resume: false } : { task_id });
      this.dialog.close();
    };
    const hasButton = this.model.canControl && task.state !== "SUCCEEDED";
    this.dialog.replaceChildren(
      dialogHead(this.dialog, "task_title", `task ${task_id}  ${taskText(task)}`),
      stateBadge(task.state),
      task.message ? element("p", task.message) : "",
      factList([["priority", String(task.priority)], ["client", task.client], ["submitted", time(task.submitted)], ["started", time(task.started)], ["ended", time(task.ended)], ["first estimate", duration(task.accepted_estimate)], [isOver ? "" : "ends in", isOver ? "" : duration(task.estimated_time)], ["took", isOver && task.started ? duration(task.ended - task.started) : ""]]),
      (complete && resultOf(task.result)) || "",
      complete ? changesOf(task) : "",
      hasButton ? element("footer", element("button", { onclick: press }, isOver ? "Queue it again" : "Cancel the task")) : "",
    );
  }
}
