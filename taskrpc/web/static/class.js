// Shows the whole class: each student with a connection, a number of calls and when it was last seen.

import { byId, element, icon, setAttribute, setIcon, setText, showEach } from "./dom.js";
import { duration, plural } from "./words.js";

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
    if (!this.model.students) return;
    const { students, more } = this.model.students;
    const connected = students.filter((student) => student.connected).length;
    setText(this.text, `${connected} of ${plural(students.length, "student")} connected${more ? `; ${more} more not shown` : ""}`);
    showEach(this.list, students, () => element("li", icon("QUEUED"), element("strong"), element("span.quiet")), (node, student) => this.show(node, student));
  }

  show(node, student) {
    setAttribute(node, "data-connected", student.connected);
    setAttribute(node, "data-student", student.name);
    setIcon(node.firstChild, student.connected ? "live" : "QUEUED");
    setText(node.children[1], student.name);
    const seen = student.connected ? plural(student.calls, "call") : student.last_seen ? `seen ${duration(this.model.now() - student.last_seen)} ago` : "not seen yet";
    setText(node.children[2], seen);
  }
}
