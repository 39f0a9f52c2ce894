// The keys of the page, the dialog that lists them, and the tabs.

import { byId, element } from "./dom.js";

const STORED = "taskrpc_keys"; // "off": the keys do nothing

/** Let arrow keys move between the tabs of a list of tabs, and show the panel of the chosen one. */
export class Tabs {
  constructor(list, shown) {
    this.tabs = [...list.querySelectorAll("[role=tab]")];
    this.shown = shown;
    list.addEventListener("click", (event) => {
      const tab = event.target.closest("[role=tab]");
      if (tab) this.choose(tab);
    });
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
      tab.setAttribute("aria-selected", String(tab === chosen));
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
    byId("help").addEventListener("click", () => this.dialog.showModal());
    this.dialog.addEventListener("click", (event) => event.target === this.dialog && this.dialog.close());
    document.addEventListener("keydown", (event) => this.pressed(event));
  }

  fill() {
    const rows = this.actions.map(({ keys, text }) => element("div", {}, element("dt", {}, ...keys.map((key) => element("kbd", {}, { " ": "Space", ArrowDown: "↓", ArrowUp: "↑" }[key] ?? key))), element("dd", {}, text)));
    const box = element("input", { type: "checkbox", id: "keys_on" });
    box.checked = this.isOn;
    box.addEventListener("change", () => {
      this.isOn = box.checked;
      localStorage.setItem(STORED, box.checked ? "on" : "off");
    });
    this.dialog.append(
      element("header", {}, element("h2", { id: "help_title" }, "Keys"), element("button", { type: "button", class: "icon_button", "aria-label": "Close", onclick: () => this.dialog.close() }, "✕")),
      element("dl", { class: "keys" }, ...rows),
      element("label", { class: "keys_switch" }, box, " Use these keys"),
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
