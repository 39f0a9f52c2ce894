// The output of the programs: their lines in the order of arrival, each with the colour of its program.

import { byId, element, setText } from "./dom.js";

const MAX_LINES = 2000;
const TONES = ["accent", "violet", "good", "warn"];
const PLACE = /File "([^"]+)", line (\d+)/;

export class Output {
  /** `go_to(file, line)` shows a line of a program. */
  constructor(go_to) {
    this.root = byId("output");
    this.go_to = go_to;
    this.tones = new Map();
    this.open = new Map(); // program -> its unfinished line
    this.clear();
  }

  clear() {
    this.root.replaceChildren();
    this.open.clear();
  }

  tone(file) {
    if (!this.tones.has(file)) this.tones.set(file, TONES[this.tones.size % TONES.length]);
    return this.tones.get(file);
  }

  /** Add output of a program, which may end within a line. */
  write({ program, text, is_error }) {
    const at_end = this.is_at_end;
    const parts = text.split("\n");
    parts.forEach((part, i) => {
      if (part) this.add_part(program, part, is_error);
      if (i < parts.length - 1) {
        if (!this.open.has(program)) this.add_part(program, "", is_error);
        this.finish(program);
      }
    });
    this.follow(at_end);
  }

  add_part(program, part, is_error) {
    let line = this.open.get(program);
    if (!line) {
      const [file] = program.split("#");
      line = this.add(file, "", { error: is_error });
      this.open.set(program, line);
    }
    line.lastChild.append(part);
  }

  /** The line is complete: a place in a program becomes a link. */
  finish(program) {
    const text = this.open.get(program).lastChild;
    const found = PLACE.exec(text.textContent);
    if (found) {
      const [all, file, line] = found;
      const [before, after] = text.textContent.split(all);
      text.replaceChildren(before, element("button.place_link", { onclick: () => this.go_to(file, Number(line)) }, all), after);
    }
    this.open.delete(program);
  }

  /** Add a remark of the page itself, or of a program. */
  note(text, { file = "", tone = "quiet" } = {}) {
    const at_end = this.is_at_end;
    this.add(file, text, { note: true, tone });
    this.follow(at_end);
  }

  add(file, text, { error = false, note = false, tone = null } = {}) {
    const line = element("li", { "data-tone": tone ?? undefined, "data-error": error, "data-note": note },
      element("span.program_name", { "data-tone": file ? this.tone(file) : "quiet" }, file.replace(/\.py$/, "") || "page"), element("span.line_text", text));
    this.root.append(line);
    if (this.root.children.length > MAX_LINES) this.root.firstChild.remove();
    setText(byId("output_empty"), "");
    return line;
  }

  get is_at_end() {
    const box = this.root.parentElement;
    return box.scrollHeight - box.scrollTop - box.clientHeight < 40;
  }

  follow(at_end) {
    const box = this.root.parentElement;
    if (at_end) box.scrollTop = box.scrollHeight;
  }
}
