// The buttons: each one calls a public service of the task server through POST /control/VERB.

import { authorization } from "./connection.js";
import { byId, element, icon, root, setAttribute, setIcon, setText } from "./dom.js";
import { duration, refusal } from "./words.js";

const SHOWN = 8000; // milliseconds that a response stays

/** Return a sentence for the response of a service. */
function said(verb, response) {
  if (verb === "submit" && response.success) return `${response.message}. Task ${response.task_id} is done in ${duration(response.estimated_time)}.`;
  return response.message || (response.success ? "Done." : "The server refused it.");
}

export class Controls {
  constructor(model) {
    this.model = model;
    this.token = "";
    this.form = byId("submit_form");
    this.text = byId("control_text");
    this.pause = byId("pause");
    this.pause.append(icon("PAUSED"), element("span"));
    this.pause.onclick = () => this.togglePause();
    byId("stop").append(icon("STOP"), "Stop");
    byId("stop").onclick = () => this.act("stop");
    this.form.onsubmit = (event) => {
      event.preventDefault();
      const [task_type, target, priority] = ["type", "target", "priority"].map((name) => byId(`submit_${name}`).value);
      this.act("submit", { task_type, target, priority: Number(priority) });
    };
  }

  get places() {
    return Object.entries(this.model.hello?.map?.places ?? {});
  }

  togglePause() {
    return this.act(this.model.tasks?.paused ? "resume" : "pause");
  }

  /** Take a point of the map as the target of the next task. */
  chooseTarget(x, y) {
    if (!this.model.canControl) return;
    const near = this.places.find(([, point]) => Math.hypot(point[0] - x, point[1] - y) < 0.35);
    byId("submit_target").value = near ? near[0] : `${x.toFixed(1)},${y.toFixed(1)}`;
    byId("submit").focus();
  }

  /** Call a service; its response is shown over the tasks. */
  async act(verb, request = {}) {
    if (!this.model.hello?.control) return this.say("This page is read-only. To control the robot, open it with: taskrpc view", "warn");
    if (!this.model.canControl) return this.say("The connection is lost: nothing was sent.", "bad");
    try {
      const response = await fetch(`/control/${verb}`, { method: "POST", headers: { "Content-Type": "application/json", ...authorization(this.token) }, body: JSON.stringify(request) });
      const body = await response.json().catch(() => ({}));
      if (!response.ok) this.say(body.message ? `${body.error}: ${body.message}` : refusal(response.status, ""), "bad");
      else this.say(said(verb, body), body.success ? "good" : "bad");
    } catch {
      this.say("The server does not respond. It is unknown whether it executed the request.", "bad");
    }
  }

  say(text, tone) {
    setText(this.text, text);
    setAttribute(this.text, "data-tone", tone);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => setText(this.text, ""), SHOWN);
  }

  update(changed) {
    if (changed.has("hello")) byId("places").replaceChildren(...this.places.map(([value]) => element("option", { value })));
    const { hello, canControl } = this.model;
    this.form.hidden = !hello?.control;
    byId("read_only").hidden = !hello || hello.control || Boolean(hello.recording);
    setAttribute(root, "data-control", hello?.control ? "" : null);
    for (const node of this.form.elements) node.disabled = !canControl;
    const paused = Boolean(this.model.tasks?.paused);
    setText(this.pause.lastChild, paused ? "Resume" : "Pause");
    setIcon(this.pause.firstChild, paused ? "RUNNING" : "PAUSED");
  }
}
