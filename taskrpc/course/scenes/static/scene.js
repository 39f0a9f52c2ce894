// Shows a scene of a lecture (`?scene=NAME`): a program with a typical mistake, what happens, why, and the cure.

import { byId, element, isProjector, query, root, setAttribute, setText, showEach } from "./dom.js";

const TONES = { program: "accent", network: "violet", robot: "good", taskrpc: "warn", simulate: "violet" };
const LEAST = 0.6; // of the usual size of the text: smaller letters cannot be read
const SHRINK = 0.95;
const link = (name) => `?scene=${name}${isProjector ? "&projector" : ""}`;

/** Return the parts of a text; what stands between two backticks becomes code. */
const parts = (text) => text.split("`").map((part, i) => (i % 2 ? element("code", part) : part));
const plain = (text) => text.replaceAll("`", "");

export class SceneView {
  constructor(model, act) {
    this.model = model;
    this.act = act;
    document.head.append(element("link", { rel: "stylesheet", href: "scene.css" }));
    this.panel = element("section.panel#scene_panel", { "aria-label": "Scene" });
    byId("page").prepend(this.panel);
    Object.assign(root.dataset, { calls_only: "", part: "calls", scene: "" });
    this.load();
  }

  async load() {
    const response = await fetch("/scenes.json");
    const scenes = await response.json();
    const at = scenes.findIndex((scene) => scene.name === query.get("scene"));
    if (at < 0) this.panel.append(element("ol.scene_list.scroll", ...scenes.map(({ name, title }) => element("li", element("a", { href: link(name) }, ...parts(title))))));
    else this.build(scenes, at);
  }

  build(scenes, at) {
    const button = (text, request) => element("button", { onclick: () => this.act("scene", { name: this.scene.name, ...request }) }, text);
    const step = (text, label, to) => (scenes[to] ? element("a.step", { href: link(scenes[to].name), "aria-label": label }, text) : null);
    this.scene = scenes[at];
    this.buttons = [button("Run", {}), button("Like ROS 2", { like_ros: true }), button("The cure", { cure: true })];
    this.buttons[0].classList.add("primary");
    this.code = element("ol.scene_code");
    this.texts = element("dl.scene_texts");
    this.earlier = element("p.quiet");
    this.moments = element("ol", { "aria-live": "polite" });
    this.parts = element("div.scene_parts", this.code, element("div.scene_moments", this.earlier, this.moments), this.texts);
    this.panel.append(
      element("header", element("h2", ...parts(this.scene.title)), element("span.spring"), ...this.buttons, step("‹", "previous scene", at - 1), step("›", "next scene", at + 1)),
      this.parts);
    byId("bottom_panel").hidden = !this.scene.robot; // otherwise, the calls stay inside the program
    this.show();
    new ResizeObserver(() => this.fit()).observe(this.parts);
  }

  update(changed) {
    if (this.scene && (changed.has("scene") || changed.has("connection"))) this.show();
  }

  show() {
    const run = this.model.scene?.name === this.scene.name ? this.model.scene : null;
    const { title, sees, ros, why, cure, code } = this.scene;
    document.title = `${plain(title)} · taskrpc`;
    for (const node of this.buttons) node.disabled = !this.model.canControl || Boolean(this.model.scene?.running);
    this.buttons.forEach((node, i) => setAttribute(node, "data-chosen", run && i === (run.cure ? 2 : run.like_ros ? 1 : 0) ? "" : null));
    setText(this.buttons[0], run ? "Run again" : "Run");
    showEach(this.code, code[run?.cure ? 1 : 0], () => element("li", element("span"), element("code")), (node, [number, text, marked]) => {
      setText(node.firstChild, String(number));
      setText(node.lastChild, text);
      setAttribute(node, "data-marked", marked ? "" : null);
    });
    const seen = run?.like_ros ? [["You see", ros]] : [["You see", sees], ["ROS 2", ros]];
    const said = !run ? [["Predict", "What will happen? Then press Run."]] : run.running ? [] : run.problem ? [["Problem", run.problem]] : run.cure ? [["Cure", cure]] : [...seen, ["Why", why]];
    this.texts.replaceChildren(...said.flatMap(([label, text]) => [element("dt", label), element("dd", ...parts(text))]));
    showEach(this.moments, run?.moments ?? [], () => element("li", element("span"), element("strong"), element("span")), (node, { at, actor, text }) => {
      setText(node.firstChild, `${at.toFixed(1)} s`);
      setText(node.children[1], actor);
      if (node.text !== text) node.lastChild.replaceChildren(...parts((node.text = text)));
      setAttribute(node, "data-tone", TONES[actor]);
    });
    this.fit();
  }

  /** Make the text smaller until all of it fits; if that is not enough, hide the first moments. */
  fit() {
    const rows = [...this.moments.children];
    const isTooHigh = () => this.parts.scrollHeight > this.parts.clientHeight;
    const hide = (count) => {
      rows.forEach((row, i) => (row.hidden = i < count));
      setText(this.earlier, count ? `${count} earlier` : "");
    };
    hide(0);
    let size = 1;
    const resize = () => (this.parts.style.fontSize = `${(size * 100).toFixed(1)}%`);
    for (resize(); isTooHigh() && size > LEAST; resize()) size *= SHRINK;
    for (let count = 1; isTooHigh() && count < rows.length; count++) hide(count);
  }
}
