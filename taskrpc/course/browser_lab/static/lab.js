// The page: it connects the lab's text, the editor, the programs, their output and the map.

import { byId, calm, element, icon, query, setIcon, setText, showEach } from "./dom.js";
import { Editor } from "./editor.js";
import { MapView } from "./map.js";
import { Model } from "./model.js";
import { Output } from "./output.js";
import { Runtime } from "./runtime.js";
import { Files } from "./store.js";
import { setUpTheme } from "./theme.js";

const TICK = 250; // milliseconds between two updates while no event comes
const SILENCE = 4000; // milliseconds without a sign of life after which the page explains Stop
const WITHOUT_SWITCHING = "This browser cannot wait inside a plain function, as rclpy does (it lacks JSPI, stack switching for WebAssembly). So the asynchronous version of the lab is shown: async def and await, with taskrpc's own API. The rclpy version runs in Chrome, Edge and Chromium from version 137.";

class Page {
  constructor(labs) {
    this.labs = labs;
    this.running = new Map(); // program -> file
    this.can_wait = null; // unknown until the worker says so
    this.checking = false;
    this.editor = new Editor(byId("editor"), { changed: (text) => this.save(text), run: () => this.run() });
    this.output = new Output((file, line) => this.go_to(file, line));
    this.model = new Model();
    this.map = new MapView(this.model, (x, y) => this.runtime.ask({ do: "move", x, y }));
    byId("run").append(icon("run"), "Run");
    byId("stop").append(icon("stop"), "Stop");
    byId("run").title = "Run all programs of the lab (Ctrl+Enter)";
    byId("run").onclick = () => this.run();
    byId("stop").onclick = () => this.stop([...this.running.keys()]);
    byId("check").onclick = () => this.check();
    byId("clear").onclick = () => this.output.clear();
    byId("reset").onclick = () => byId("reset_dialog").showModal();
    byId("reset_no").onclick = () => byId("reset_dialog").close();
    byId("reset_yes").onclick = () => this.reset();
    byId("lab").append(...labs.map(({ number, title }) => element("option", { value: number }, `Lab ${number}: ${title}`)));
    byId("lab").onchange = (event) => this.open(Number(event.target.value));
    byId("version").append(element("option", { value: "rclpy" }, "rclpy"), element("option", { value: "async" }, "asynchronous"));
    byId("version").onchange = (event) => this.open_version(event.target.value);
    this.runtime = new Runtime((event) => this.received(event));
    this.open(Number(query.get("lab")) || labs[0].number);
    this.show_state();
    this.requested = 0;
    setInterval(() => this.wake(), TICK);
  }

  // The lab and its files

  open(number) {
    this.lab = this.labs.find((lab) => lab.number === number) ?? this.labs[0];
    byId("lab").value = this.lab.number;
    setText(byId("lab_title"), this.lab.title);
    setText(byId("lab_facts"), `about ${this.lab.minutes} minutes`);
    byId("lab_goal").replaceChildren(...marked(this.lab.goal));
    byId("steps").replaceChildren(...this.lab.steps.map((step) => element("li", ...marked(step))));
    byId("checks").hidden = true;
    byId("task").open = true;
    document.title = `Lab ${this.lab.number}: ${this.lab.title}`;
    byId("version").hidden = !this.lab.async_files.length;
    this.open_version(this.can_wait === false ? "async" : "rclpy");
  }

  open_version(version) {
    this.files = new Files(this.lab, version);
    byId("version").value = version;
    byId("tabs").replaceChildren(...this.files.names.map((name) => element("button", { role: "tab", "data-file": name, title: name, "aria-controls": "editor", onclick: () => this.show(name) }, label(name, this.files.names))));
    byId("tabs").onkeydown = (event) => this.tab_key(event);
    this.arguments = new Map(this.files.starters.filter((file) => file.arguments).map((file) => [file.name, argument_field(file)]));
    byId("programs").replaceChildren();
    this.show(this.files.names[0]);
    this.show_buttons();
  }

  tab_key({ key }) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
    if (!step) return;
    const { names } = this.files;
    this.show(names[(names.indexOf(this.file) + step + names.length) % names.length]);
    byId("tabs").querySelector('[aria-selected="true"]').focus();
  }

  show(name) {
    this.file = name;
    for (const tab of byId("tabs").children) {
      const is_shown = tab.dataset.file === name;
      tab.setAttribute("aria-selected", is_shown);
      tab.tabIndex = is_shown ? 0 : -1;
    }
    this.editor.show(name, this.files.text(name), `File ${name}. Tab indents; press Escape and then Tab to leave the editor.`);
    this.show_saved();
  }

  save(text) {
    const is_kept = this.files.save(this.file, text);
    this.show_saved(is_kept);
  }

  show_saved(is_kept = true) {
    const text = this.files.is_changed(this.file) ? "saved in this browser" : "starter file";
    setText(byId("saved"), is_kept ? text : "this browser stores nothing: copy your program before you close the page");
  }

  reset() {
    this.files.reset();
    byId("reset_dialog").close();
    this.show(this.file);
  }

  go_to(file, line) {
    if (!this.files.names.includes(file)) return;
    this.show(file);
    this.editor.go_to(line);
  }

  // The programs

  run() {
    if (this.can_wait === null || this.checking) return;
    this.output.clear();
    this.running.clear();
    this.runtime.ask_fresh({ do: "start", files: this.files.all(), programs: this.arguments_of(this.files.programs) });
    this.awaited(this.files.programs.length);
  }

  /** Remember that programs must show a sign of life. */
  awaited() {
    this.busy = true;
    this.heard_at = performance.now();
    this.show_state();
  }

  start(file) {
    this.runtime.ask({ do: "start", files: this.files.all(), programs: this.arguments_of([file]) });
    this.awaited();
  }

  /** Return the programs with the arguments in the fields beside their names. */
  arguments_of(files) {
    return Object.fromEntries(files.map((file) => [file, this.arguments.get(file)?.value ?? ""]));
  }

  stop(programs) {
    if (this.checking) return this.restart("The check was stopped.");
    this.runtime.stop(programs, () => this.all_ended("The programs did not react to Stop, as Ctrl-C does it, so they were ended: one of them computes without ever waiting."));
    if (!programs.length) this.restart("The programs were ended.");
  }

  restart(words) {
    this.runtime.begin();
    this.all_ended(words);
  }

  all_ended(words) {
    for (const [, file] of this.running) this.output.note("ended", { file });
    this.running.clear();
    this.checking = this.busy = false;
    if (words) this.output.note(words, { tone: "warn" });
    this.show_state();
  }

  check() {
    if (this.can_wait === null || this.checking) return;
    this.all_ended("");
    this.output.clear();
    this.checking = true;
    byId("checks").hidden = false;
    byId("findings").replaceChildren(element("li.quiet", "Checking…"));
    this.runtime.ask_fresh({ do: "check", files: this.files.all(), lab: this.lab.number, variant: this.lab.variant });
    this.heard_at = performance.now();
    this.show_state();
  }

  // The events of the worker

  received({ event, ...values }) {
    this.heard_at = performance.now();
    this[`on_${event}`]?.(values);
    this.show_state();
    this.wake();
  }

  on_ready({ can_wait }) {
    const is_new = this.can_wait !== can_wait;
    this.can_wait = can_wait;
    if (is_new && !can_wait) {
      setText(byId("banner"), WITHOUT_SWITCHING);
      byId("banner").hidden = false;
      this.open_version("async");
    }
  }

  on_broken({ text }) {
    this.broken = text;
    setText(byId("banner"), `Python could not be loaded: ${text}. Reload the page; if that does not help, the server of this page may have ended.`);
    byId("banner").hidden = false;
  }

  on_started({ program, file }) {
    this.running.set(program, file);
    this.busy = false;
  }

  on_output(values) {
    this.output.write(values);
    const found = /File "([^"]+)", line (\d+)/.exec(values.text);
    if (found && values.is_error && found[1] === this.file) this.editor.mark_line(Number([...values.text.matchAll(/File "([^"]+)", line (\d+)/g)].at(-1)[2]));
  }

  on_ended({ program, file, code }) {
    this.running.delete(program);
    const words = code === 130 ? "stopped" : code === 0 ? "ended" : `ended with exit code ${code}`;
    if (!this.checking) this.output.note(words, { file, tone: code === 0 || code === 130 ? "quiet" : "bad" });
  }

  on_stopped() {
    this.runtime.stopped();
  }

  on_problem({ text }) {
    this.output.note(text, { tone: "bad" });
  }

  on_console({ text }) {
    console.info(text);
  }

  on_moving({ text }) {
    setText(byId("robot_task"), text);
  }

  on_robot({ name, data }) {
    this.model.apply(name, data);
    if (name === "hello") this.model.setConnection("live", "");
    if (name === "tasks" && data.running) setText(byId("robot_task"), `Task ${data.running.task_id}: ${data.running.task_type} ${data.running.target}, priority ${data.running.priority}${data.queued ? `; ${data.queued} more in the queue` : ""}`);
  }

  on_finding({ title, passed, expected, happened, look, waits_for, index }) {
    if (index === 0) byId("findings").replaceChildren();
    const tone = passed ? "good" : waits_for ? "quiet" : "bad";
    const words = passed ? [] : waits_for ? [element("p.quiet", `not checked: it needs “${waits_for}”`)] : [
      element("dl", element("dt", "expected"), element("dd", ...marked(expected)), element("dt", "happened"), element("dd", ...marked(happened)), element("dt", "look"), element("dd", ...marked(look)))];
    byId("findings").append(element("li", { "data-tone": tone, "data-passed": passed }, icon(passed ? "passed" : waits_for ? "waiting" : "failed"), element("div", element("strong", title), ...words)));
  }

  on_checked({ passed, total }) {
    this.checking = false;
    byId("findings").append(element("li.total", { "data-tone": passed === total ? "good" : "quiet" }, passed === total ? `All ${total} checks passed.` : `${passed} of ${total} checks passed.`));
    const text = byId("task").parentElement;
    if (text.scrollHeight > text.clientHeight) byId("task").open = false; // the findings need the room
    byId("findings").lastChild.scrollIntoView({ block: "nearest", behavior: calm.matches ? "auto" : "smooth" });
  }

  // What the page shows

  show_buttons() {
    const is_active = this.running.size > 0 || this.busy || this.checking;
    byId("run").disabled = this.can_wait === null || this.checking;
    byId("check").disabled = this.can_wait === null || this.checking;
    byId("stop").disabled = !is_active;
    const files = [...new Set(this.running.values())];
    showEach(byId("programs"), this.files.programs, () => element("li", element("span.dot"), element("span"), element("button.icon_button")), (item, file) => {
      const is_running = files.includes(file);
      const name = item.children[1];
      const button = item.lastChild;
      if (this.arguments.has(file) && item.children.length === 3) button.before(this.arguments.get(file));
      item.dataset.running = is_running;
      item.dataset.tone = this.output.tone(file);
      setText(name, file);
      const verb = is_running ? "Stop" : "Start";
      button.setAttribute("aria-label", `${verb} ${file} alone`);
      button.title = `${verb} ${file} alone`;
      button.disabled = this.can_wait === null || this.checking;
      if (!button.firstChild) button.append(icon("run"));
      setIcon(button.firstChild, is_running ? "stop" : "run");
      button.onclick = () => (is_running ? this.stop([...this.running].filter(([, each]) => each === file).map(([program]) => program)) : this.start(file));
    });
  }

  show_state() {
    const is_loading = this.can_wait === null || !this.runtime.is_ready;
    const silent = (this.busy || this.running.size > 0) && performance.now() - this.heard_at > SILENCE;
    const [tone, words] = this.broken ? ["bad", "Python could not be loaded"]
      : is_loading ? ["quiet", "Loading Python…"]
      : silent ? ["warn", "no sign of life: does a loop never wait? Press Stop"]
      : this.checking ? ["accent", "Checking…"]
      : this.running.size ? ["accent", `${this.running.size} ${this.running.size === 1 ? "program runs" : "programs run"}`]
      : ["good", "Ready"];
    byId("state").dataset.tone = tone;
    setText(byId("state"), words);
    this.show_buttons();
  }

  /** Draw at the next frame; between two of them, the style sheet moves the robot. */
  wake() {
    this.requested ||= requestAnimationFrame(() => this.frame());
  }

  frame() {
    this.requested = 0;
    if (this.model.changed.size) {
      this.map.update(this.model.changed);
      this.model.changed = new Set();
    }
    this.map.frame(this.model.now());
    if (this.running.size || this.busy) this.show_state();
  }
}

/** Return what the tab of a file shows: its name without folders, unless another file has the same. */
function label(name, names) {
  const last = (each) => each.split("/").at(-1);
  return names.filter((each) => last(each) === last(name)).length > 1 ? name : last(name);
}

/** Return the field for the arguments of a program. */
function argument_field({ name, arguments: value }) {
  return element("input.arguments", { value, "aria-label": `Arguments of ${name}`, spellcheck: "false", autocomplete: "off" });
}

/** Return a text as nodes: `parts` in backquotes become code. */
function marked(text) {
  return text.split("`").map((part, i) => (i % 2 ? element("code", part) : part));
}

setUpTheme();
const { labs } = await (await fetch("labs.json")).json();
globalThis.page = new Page(labs); // for tests, and for the curious
