// Starts the page: connects the event stream, the model and the views, and draws what has changed.

import { CallList, CallsView } from "./calls.js";
import { ClassView } from "./class.js";
import { LiveStream, takeToken } from "./connection.js";
import { Controls } from "./controls.js";
import { Details } from "./details.js";
import { byId, icon, setAttribute, setIcon, setText } from "./dom.js";
import { GraphView } from "./graph.js";
import { Keyboard, Tabs } from "./keyboard.js";
import { MapView } from "./map.js";
import { Model } from "./model.js";
import { Recording } from "./recording.js";
import { SlowMotion } from "./slow_motion.js";
import { StatusView } from "./status.js";
import { TasksView } from "./tasks.js";

const TICK = 250; // milliseconds between two updates of the numbers that count
const root = document.documentElement;
if (new URLSearchParams(location.search).has("projector")) root.dataset.projector = "";

const token = takeToken();
const model = new Model();
const controls = new Controls(model);
const act = (verb, request) => controls.act(verb, request);
const details = new Details(model, act);
const open = (id) => details.open(id);
controls.token = details.token = token;

const map = new MapView(model, (x, y) => controls.chooseTarget(x, y));
const tasks = new TasksView(model, open, act);
const calls = new CallsView(model);
const slow = new SlowMotion(model, calls);
const list = new CallList(model);
const graph = new GraphView(model);
const students = new ClassView(model);
const status = new StatusView(model);
let recording = null;

const tabs = new Tabs(byId("tabs"), (panel) => {
  byId("bottom_panel").dataset.panel = panel;
  calls.resize();
  list.tick();
  graph.update(new Set());
});

function toggleSlowMotion() {
  slow.setMode(slow.mode === "playing" ? "live" : "playing");
  showMode();
}

function step() {
  tabs.choose(byId("tab_calls"));
  slow.step();
  showMode();
}

function showMode() {
  setAttribute(byId("slow_motion"), "aria-pressed", slow.mode === "playing");
  setAttribute(byId("bottom_panel"), "data-mode", slow.mode);
  setText(byId("step").lastChild, slow.mode === "stepping" ? "Next message" : "Step");
  byId("live_calls").hidden = slow.mode === "live";
}

function back() {
  slow.setMode("live");
  showMode();
}

function setUpMessageButtons() {
  byId("step").append(icon("step"), document.createElement("span"));
  const live = document.createElement("button");
  Object.assign(live, { id: "live_calls", type: "button", textContent: "Live" });
  byId("step").after(live);
  live.addEventListener("click", back);
  byId("slow_motion").addEventListener("click", toggleSlowMotion);
  byId("step").addEventListener("click", step);
  showMode();
}

function setUpTheme() {
  const button = byId("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  button.append(icon("dark"));
  const show = () => setIcon(button.firstChild, root.dataset.theme === "dark" || (!root.dataset.theme && dark.matches) ? "light" : "dark");
  const stored = localStorage.getItem("taskrpc_theme");
  if (stored) root.dataset.theme = stored;
  dark.addEventListener("change", show);
  button.addEventListener("click", () => {
    root.dataset.theme = root.dataset.theme === "dark" || (!root.dataset.theme && dark.matches) ? "light" : "dark";
    localStorage.setItem("taskrpc_theme", root.dataset.theme);
    show();
  });
  show();
}

function setUpParts() {
  const buttons = [...byId("phone_tabs").children];
  const choose = (part) => {
    root.dataset.part = part;
    for (const button of buttons) setAttribute(button, "aria-pressed", button.dataset.part === part);
  };
  for (const button of buttons) button.addEventListener("click", () => choose(button.dataset.part));
  choose("robot");
}

function reprioritise(by) {
  const task = tasks.queue.selected();
  if (!task) return false;
  const priority = Math.max(1, Math.min(10, task.priority + by));
  if (priority !== task.priority) act("reprioritise", { task_id: task.task_id, priority });
}

function onSelected(use) {
  return () => {
    const task = tasks.queue.selected();
    if (!task) return false;
    use(task);
  };
}

new Keyboard([
  { keys: ["?"], text: "show this list", act: () => byId("help_dialog").showModal() },
  { keys: ["j", "k", "ArrowDown", "ArrowUp"], text: "select the next, previous task of the queue", act: ({ key }) => (key.length > 1 && !tasks.queue.selected() ? false : tasks.queue.step(["j", "ArrowDown"].includes(key) ? 1 : -1)) },
  { keys: ["Enter"], text: "show the details of the task", act: onSelected((task) => open(task.task_id)) },
  { keys: ["+", "-"], text: "raise, lower the priority of the task", act: ({ key }) => reprioritise(key === "+" ? 1 : -1) },
  { keys: ["x", "Delete"], text: "cancel the task", act: onSelected((task) => act("cancel", { task_id: task.task_id })) },
  { keys: ["n"], text: "new task", act: () => (model.canControl ? byId("submit_target").focus() : act("submit")) },
  { keys: ["p"], text: "pause or resume the queue", act: () => controls.togglePause() },
  { keys: ["S"], text: "stop the robot", act: () => act("stop") },
  { keys: ["m"], text: "show the messages in slow motion", act: toggleSlowMotion },
  { keys: ["."], text: "show the next message only", act: step },
  { keys: ["l"], text: "back to the live calls", act: back },
  { keys: ["1", "2", "3", "4"], text: "show the tab Calls, List, Nodes or Class", act: (event) => tabs.choose(tabs.tabs[Number(event.key) - 1]) },
  { keys: [" "], text: "play or pause a recording", act: () => (recording?.clock ? recording.setPlaying(!recording.isPlaying) : false) },
  { keys: ["[", "]"], text: "previous, next event of a recording", act: ({ key }) => recording?.step(key === "]" ? 1 : -1) },
  { keys: ["t"], text: "switch between light and dark", act: () => byId("theme").click() },
]);

/** Stop the live stream, and load the recording that the server serves. */
async function openRecording() {
  stream.stop();
  recording = new Recording(model, token);
  model.setConnection("recording", model.hello.recording.name);
  try {
    await recording.load();
  } catch (error) {
    model.setConnection("refused", error.message);
  }
}

const stream = new LiveStream(token, (name, data) => {
  model.apply(name, data);
  if (name === "hello" && data.recording) openRecording();
  wake();
}, (state, text) => {
  model.setConnection(state, text);
  wake();
});

let requested = 0;
let ticked = 0;

/** Draw at the next frame. */
function wake() {
  requested ||= requestAnimationFrame(frame);
}

/**
 * Bring the page up to date; nothing here reads the layout. A live page does this some ten times a
 * second: in between, the browser moves the calls, the robot and the bar without any script.
 */
function frame(time) {
  requested = 0;
  if (recording?.clock) {
    recording.frame();
    wake();
  }
  const { changed } = model;
  if (changed.size) {
    model.changed = new Set();
    for (const view of [status, controls, map, tasks, calls, slow, list, graph, students]) view.update?.(changed);
    model.new_calls = [];
  }
  const now = model.now();
  map.frame(now);
  tasks.frame();
  calls.frame(now);
  slow.frame();
  if (time - ticked < TICK / 2) return;
  ticked = time;
  for (const view of [status, tasks, calls, list]) view.tick();
}

setUpMessageButtons();
setUpTheme();
setUpParts();
stream.run();
setInterval(wake, TICK);
