// Starts the page: connects the event stream, the model and the views, and draws what has changed.

import { CallList, CallsView } from "./calls.js";
import { ClassView } from "./class.js";
import { LiveStream, takeToken } from "./connection.js";
import { Controls } from "./controls.js";
import { Details } from "./details.js";
import { byId, element, icon, isProjector, query, root, setAttribute, setText } from "./dom.js";
import { GraphView } from "./graph.js";
import { Keyboard, Tabs } from "./keyboard.js";
import { MapView } from "./map.js";
import { Model } from "./model.js";
import { StatusView } from "./status.js";
import { TasksView } from "./tasks.js";
import { setUpTheme } from "./theme.js";

const TICK = 250; // milliseconds between two updates of the numbers that count
if (isProjector) root.dataset.projector = "";

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
const list = new CallList(model);
const graph = new GraphView(model);
const students = new ClassView(model);
const status = new StatusView(model);
const views = [status, controls, map, tasks, calls, graph, students];
let recording = null;
let slow = null;

const tabs = new Tabs(byId("tabs"), (panel) => {
  byId("bottom_panel").dataset.panel = panel;
  calls.resize();
  list.tick();
  graph.update(new Set());
});

let wanted = byId(`tab_${query.get("view")}`); // the tab of `?view=class`, which appears with the first student

/** Load the slow motion, use it and show its mode. */
async function withSlowMotion(use) {
  const module = await import("./slow_motion.js").catch(() => null);
  if (!module) return setText(byId("message_text"), "Slow motion cannot be loaded: the server does not answer.");
  if (!slow) views.push((slow = new module.SlowMotion(model, calls)));
  use();
  showMode();
}

const toggleSlowMotion = () => withSlowMotion(() => slow.setMode(slow.mode === "playing" ? "live" : "playing"));

function step() {
  tabs.choose(byId("tab_calls"));
  return withSlowMotion(() => slow.step());
}

function showMode() {
  const mode = slow?.mode ?? "live";
  setAttribute(byId("slow_motion"), "aria-pressed", mode === "playing");
  setAttribute(byId("bottom_panel"), "data-mode", mode);
  setText(byId("step").lastChild, mode === "stepping" ? "Next message" : "Step");
  byId("live_calls").hidden = mode === "live";
}

const back = () => slow && withSlowMotion(() => slow.setMode("live"));

function setUpMessageButtons() {
  byId("step").append(icon("step"), element("span"));
  byId("live_calls").onclick = back;
  byId("slow_motion").onclick = toggleSlowMotion;
  byId("step").onclick = step;
  showMode();
}

function setUpParts() {
  const buttons = [...byId("phone_tabs").children];
  const choose = (part) => {
    root.dataset.part = part;
    for (const button of buttons) setAttribute(button, "aria-pressed", button.dataset.part === part);
  };
  for (const button of buttons) button.onclick = () => choose(button.dataset.part);
  choose(query.has("view") ? "calls" : "robot");
}

/** Return the action of a key for the selected task; without one, the browser gets the key. */
function onSelected(use) {
  return (event) => {
    const task = tasks.queue.selected();
    return task ? use(task, event) : false;
  };
}

function reprioritise(task, { key }) {
  const priority = task.priority + (key === "+" ? 1 : -1);
  if (priority >= 1 && priority <= 10) act("reprioritise", { task_id: task.task_id, priority });
}

new Keyboard([
  { keys: ["?"], text: "show this list", act: () => byId("help_dialog").showModal() },
  { keys: ["j", "k", "ArrowDown", "ArrowUp"], text: "select the next, previous task of the queue", act: ({ key }) => (key.length > 1 && !tasks.queue.selected() ? false : tasks.queue.step(["j", "ArrowDown"].includes(key) ? 1 : -1)) },
  { keys: ["Enter"], text: "show the details of the task", act: onSelected((task) => open(task.task_id)) },
  { keys: ["+", "-"], text: "raise, lower the priority of the task", act: onSelected(reprioritise) },
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
  model.setConnection("recording", model.hello.recording.name);
  try {
    const { Recording } = await import("./recording.js");
    recording = new Recording(model, token, calls);
    await recording.load();
  } catch (error) {
    model.setConnection("refused", error.message);
  }
}

const stream = new LiveStream(token, (name, data) => {
  model.apply(name, data);
  if (name === "hello" && data.recording) openRecording();
  if (data.scenes && !query.has("scene")) location.replace("?scene=");
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
    for (const view of views) view.update(changed);
    model.new_calls = [];
    if (wanted?.hidden === false) {
      tabs.choose(wanted);
      wanted = null;
    }
  }
  const now = model.now();
  map.frame(now);
  tasks.frame();
  calls.frame(now);
  slow?.frame();
  if (time - ticked < TICK / 2) return;
  ticked = time;
  for (const view of [status, tasks, calls, list, students]) view.tick();
}

/** Show the scene of `?scene=NAME`; only the server of `taskrpc scene --page` has this module. */
function setUpScene() {
  const note = "This server has no scenes. Type: taskrpc scene --page";
  import("./scene.js").then(({ SceneView }) => views.push(new SceneView(model, act)), () => byId("page").prepend(element("p.panel.empty#no_scenes", note)));
}

tabs.choose(byId("tab_calls"));
if (query.has("scene")) setUpScene();
setUpMessageButtons();
setUpTheme();
setUpParts();
stream.run();
setInterval(wake, TICK);
