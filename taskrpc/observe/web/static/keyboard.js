// The keys of the page, the dialog that lists them, and the tabs.

import { byId, dialogHead, element } from "./dom.js";

const STORED = "taskrpc_keys"; // "off": the keys do nothing

/** Let arrow keys move between the tabs of a list of tabs, and show the panel of the chosen one. */
export class Tabs {
  constructor(list, shown) {
    this.tabs = [...list.children];
    this.shown = shown;
    for (const tab of this.tabs) tab.onclick = () => this.choose(tab);
    list.addEventListener("keydown", (event) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!by) return;
      const tabs = this.tabs.filter((tab) => !tab.hidden);
      this.choose(tabs[(tabs.indexOf(event.target) + by + tabs.length) % tabs.length], true);
      event.preventDefault();
    });
  }

  choose(chosen, focus = false) {
    if (!chosen || chosen.hidden) return;
    for (const tab of this.tabs) {
      tab.ariaSelected = tab === chosen;
      tab.tabIndex = tab === chosen ? 0 : -1;
      byId(tab.getAttribute("aria-controls")).hidden = tab !== chosen;
    }
    if (focus) chosen.focus();
    this.shown(chosen.getAttribute("aria-controls"));
  }
}

/** The keys: `actions` is a list of `{keys, text, act}`; `keys` are values of KeyboardEvent.key. */
export class Keyboard {
  constructor(actions) {
    this.actions = actions;
    this.dialog = byId("help_dialog");
    this.isOn = localStorage.getItem(STORED) !== "off";
    this.fill();
    byId("help").onclick = () => this.dialog.showModal();
    document.addEventListener("keydown", (event) => this.pressed(event));
  }

  fill() {
    const rows = this.actions.map(({ keys, text }) => element("div", element("dt", ...keys.map((key) => element("kbd", { " ": "Space", ArrowDown: "↓", ArrowUp: "↑" }[key] ?? key))), element("dd", text)));
    const change = () => {
      this.isOn = box.checked;
      localStorage.setItem(STORED, box.checked ? "on" : "off");
    };
    const box = element("input#keys_on", { type: "checkbox", checked: this.isOn, onchange: change });
    this.dialog.append(
      dialogHead(this.dialog, "help_title", "Keys"),
      element("dl.keys", ...rows),
      element("label", box, " Use these keys"),
    );
  }

  pressed(event) {
    const target = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (event.key === "Escape") return target.blur?.();
    if (!this.isOn || target.closest?.("input, select, textarea")) return;
    // Enter and the space bar belong to the focused button.
    if ((event.key === " " || event.key === "Enter") && target.closest?.("button, summary, [role=tab]")) return;
    const action = this.actions.find(({ keys }) => keys.includes(event.key));
    if (!action || action.act(event) === false) return;
    event.preventDefault();
  }
}
