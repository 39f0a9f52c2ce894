// A small editor: a text area over a coloured copy of its text, with line numbers.

import { element, setText } from "./dom.js";

const INDENT = "    ";

const PYTHON = /(?<comment>#.*)|(?<string>[rbf]{0,2}(?:"""[\s\S]*?(?:"""|$)|'''[\s\S]*?(?:'''|$)|"(?:\\.|[^"\\\n])*"?|'(?:\\.|[^'\\\n])*'?))|(?<word>\b(?:and|as|assert|async|await|break|class|continue|def|del|elif|else|except|False|finally|for|from|global|if|import|in|is|lambda|None|nonlocal|not|or|pass|raise|return|True|try|while|with|yield)\b)|(?<mark>@[\w.]+)|(?<number>\b\d[\d_.]*(?:e[+-]?\d+)?\b)/g;
const DEFINITION = /(?<comment>#.*)|(?<mark>^---$)|(?<word>\b(?:bool|byte|char|float32|float64|u?int(?:8|16|32|64)|w?string)\b)|(?<number>\b\d[\d_.]*\b)/gm;

/** Return the text as nodes, with a span around each part that has a colour. */
export function coloured(text, name) {
  const nodes = [];
  let end = 0;
  for (const match of text.matchAll(name.endsWith(".py") ? PYTHON : DEFINITION)) {
    const [kind] = Object.entries(match.groups).find(([, value]) => value !== undefined);
    nodes.push(text.slice(end, match.index), element(`span.code_${kind}`, match[0]));
    end = match.index + match[0].length;
  }
  return [...nodes, text.slice(end), "\n"]; // the last line needs an end to be as high as in the text area
}

export class Editor {
  /** `changed(text)` is called after each change by the user; `run()` at Ctrl+Enter. */
  constructor(root, { changed, run }) {
    this.changed = changed;
    this.name = "";
    this.marked = 0;
    this.numbers = element("div.line_numbers", { "aria-hidden": "true" });
    this.copy = element("pre.code_copy", { "aria-hidden": "true" });
    this.area = element("textarea#code", { spellcheck: "false", autocapitalize: "off", autocomplete: "off", wrap: "off", "aria-label": "Program" });
    this.mark = element("div.line_mark", { hidden: true });
    this.layer = element("div.code_layer", this.mark, this.copy, this.area);
    root.append(this.numbers, this.layer);
    this.area.addEventListener("input", () => this.edited());
    this.area.addEventListener("scroll", () => this.scrolled());
    this.area.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) {
        event.preventDefault();
        run();
      } else this.key(event);
    });
  }

  show(name, text, label) {
    this.name = name;
    this.area.value = text;
    this.area.setAttribute("aria-label", label);
    this.area.scrollTo(0, 0);
    this.mark_line(0);
    this.draw();
  }

  edited() {
    this.mark_line(0);
    this.draw();
    this.changed(this.area.value);
  }

  draw() {
    const text = this.area.value;
    this.copy.replaceChildren(...coloured(text, this.name));
    const count = text.split("\n").length;
    setText(this.numbers, Array.from({ length: count }, (_, i) => i + 1).join("\n"));
    this.scrolled();
  }

  scrolled() {
    const { scrollTop, scrollLeft } = this.area;
    this.copy.style.transform = `translate(${-scrollLeft}px, ${-scrollTop}px)`;
    this.numbers.scrollTop = scrollTop;
    this.mark.style.transform = `translateY(${-scrollTop}px)`;
  }

  /** Mark a line that an error names; 0 marks none. */
  mark_line(line) {
    this.mark.hidden = line === 0;
    this.mark.style.top = `calc(${line - 1} * var(--code_line) + .5rem)`;
  }

  /** Put the cursor into a line, and show the line. */
  go_to(line) {
    const start = this.area.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    this.area.focus();
    this.area.setSelectionRange(start, start);
    const height = parseFloat(getComputedStyle(this.area).lineHeight);
    this.area.scrollTop = Math.max(0, (line - 4) * height);
    this.mark_line(line);
  }

  key(event) {
    if (event.isComposing || event.ctrlKey || event.metaKey || event.altKey) return;
    // Escape lets the keyboard leave the editor: the next Tab moves the focus.
    if (event.key === "Escape") this.leaving = true;
    else if (event.key === "Tab" && !this.leaving) this.tab(event);
    else if (event.key === "Enter") this.enter(event);
    else this.leaving = false;
  }

  tab(event) {
    event.preventDefault();
    const { value, selectionStart: start, selectionEnd: end } = this.area;
    const first = value.lastIndexOf("\n", start - 1) + 1;
    if (start === end && !event.shiftKey) {
      this.insert(INDENT.slice((start - first) % INDENT.length));
      return;
    }
    const lines = value.slice(first, end).split("\n");
    const moved = lines.map((line) => (event.shiftKey ? line.replace(/^ {1,4}/, "") : INDENT + line));
    this.area.setSelectionRange(first, end);
    this.insert(moved.join("\n"));
    this.area.setSelectionRange(first, first + moved.join("\n").length);
  }

  enter(event) {
    event.preventDefault();
    const before = this.area.value.slice(0, this.area.selectionStart);
    const line = before.slice(before.lastIndexOf("\n") + 1);
    const indent = /^ */.exec(line)[0];
    this.insert(`\n${indent}${/:\s*(#.*)?$/.test(line) && this.name.endsWith(".py") ? INDENT : ""}`);
  }

  insert(text) {
    // The old command is the only one that keeps the browser's undo.
    if (!document.execCommand(text ? "insertText" : "delete", false, text)) {
      this.area.setRangeText(text, this.area.selectionStart, this.area.selectionEnd, "end");
      this.edited();
    }
  }
}
