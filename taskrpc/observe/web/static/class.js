// Shows the whole class: who is connected, who is stuck and why, how many calls and queued tasks each has.

import { byId, element, icon, isProjector, setAttribute, setIcon, setText, showEach } from "./dom.js";
import { duration, meaning, plural } from "./words.js";

const isStuck = (student) => student.progress === "stuck";

/** Return why the student's last call failed, "" if it succeeded. */
const problemText = ({ problem }) => (problem ? `${problem.service}: ${problem.message || meaning(problem.code) || problem.code}` : "");

export class ClassView {
  constructor(model) {
    this.model = model;
    this.list = element("ul.students#students");
    this.text = element("p.quiet");
    byId("class").append(this.text, this.list);
  }

  update(changed) {
    if (!changed.has("class")) return;
    byId("tab_class").hidden = !this.model.students;
    this.tick();
  }

  /** Show the students; the texts contain times, which pass. */
  tick() {
    if (!this.model.students) return;
    const { students, more } = this.model.students;
    const connected = students.filter((student) => student.connected).length;
    const stuck = students.filter(isStuck).sort((a, b) => a.begun - b.begun);
    const others = isProjector ? "; calls of each" : stuck.length ? ` · ${stuck.length} without a successful call` : "";
    setText(this.text, `${connected} of ${plural(students.length, "student")} connected${others}${more ? `; ${more} more not shown` : ""}`);
    // On a projector, nobody is put first or counted for being stuck.
    const shown = isProjector ? students : [...stuck, ...students.filter((student) => !isStuck(student))];
    showEach(this.list, shown, () => element("li", icon("QUEUED"), element("strong"), element("span.quiet")), (node, student) => this.show(node, student));
  }

  show(node, student) {
    setAttribute(node, "data-connected", student.connected);
    setAttribute(node, "data-progress", student.progress);
    setAttribute(node, "data-student", student.name);
    setAttribute(node, "title", isProjector ? null : problemText(student) || null);
    setIcon(node.firstChild, isStuck(student) ? "lost" : student.connected ? "live" : "QUEUED");
    setText(node.children[1], student.name);
    setText(node.children[2], this.about(student));
  }

  about(student) {
    if (isStuck(student)) {
      const minutes = Math.floor((this.model.now() - student.begun) / 60);
      return `${minutes} min without a successful call · ${problemText(student) || (student.connected ? "connected, no call yet" : "has joined, no call yet")}`;
    }
    if (student.progress === "away") return student.last_seen ? `seen ${duration(this.model.now() - student.last_seen)} ago` : "not seen yet";
    return isProjector ? student.calls : plural(student.calls, "call") + (student.queued ? ` · ${student.queued} queued` : "");
  }
}
