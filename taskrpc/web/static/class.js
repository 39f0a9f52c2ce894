// Shows the whole class: each student with a connection, a number of calls and when it was last seen.

import { byId, element, icon, setAttribute, setIcon, setText } from "./dom.js";
import { duration, plural } from "./words.js";

export class ClassView {
  constructor(model) {
    this.model = model;
    this.root = byId("class");
    this.tab = byId("tab_class");
    this.list = element("ul", { class: "students", id: "students" });
    this.text = element("p", { class: "quiet" });
    this.root.append(this.text, this.list);
  }

  update(changed) {
    if (!changed.has("class")) return;
    const { students } = this.model;
    this.tab.hidden = !students;
    if (!students) return;
    const connected = students.students.filter((student) => student.connected).length;
    setText(this.text, `${connected} of ${plural(students.students.length, "student")} connected${students.more ? `; ${students.more} more are not shown` : ""}`);
    while (this.list.children.length > students.students.length) this.list.lastChild.remove();
    while (this.list.children.length < students.students.length)
      this.list.append(element("li", {}, icon("QUEUED"), element("span", { class: "student_name" }), element("span", { class: "quiet" })));
    students.students.forEach((student, i) => this.show(this.list.children[i], student));
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
