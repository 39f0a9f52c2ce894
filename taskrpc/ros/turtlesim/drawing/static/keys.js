// Sends the keys of turtle_teleop_key to the server: the arrows drive, the letters around F turn.

import { authorization } from "./connection.js";
import { setAttribute, setText } from "./dom.js";

const ARROWS = { ArrowUp: "up", ArrowDown: "down", ArrowLeft: "left", ArrowRight: "right" };
const LETTERS = "gtredcvbf";
const MAY = "Press the arrow keys. G, T, R, E, D, C, V and B turn the turtle to the direction in which the key lies from F; F stops this turn.";
const MAY_NOT = "This page only shows. To drive, open the link that turtlesim_node printed, or run turtle_teleop_key.";

export class Keys {
  constructor(token, pad, text) {
    this.token = token;
    this.buttons = [...pad.querySelectorAll("button")];
    this.text = text;
    this.isSending = false;
    this.isAllowed = false;
    for (const button of this.buttons) button.onclick = () => this.press(button.dataset.key);
    document.addEventListener("keydown", (event) => this.keyDown(event));
    this.stop();
  }

  /** Say whether the server accepts keys of this page. */
  begin(isAllowed) {
    this.isAllowed = isAllowed;
    for (const button of this.buttons) button.disabled = !isAllowed;
    setText(this.text, isAllowed ? MAY : MAY_NOT);
  }

  /** Take no keys, because the page is not connected. */
  stop() {
    this.begin(false);
    setText(this.text, "");
  }

  keyDown(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || !this.isAllowed) return;
    const letter = event.key.toLowerCase();
    const key = ARROWS[event.key] ?? (letter.length === 1 && LETTERS.includes(letter) ? letter : "");
    if (!key) return;
    event.preventDefault(); // the arrows would scroll
    this.press(key);
  }

  /** Send a key; while one is on its way, further ones are dropped, as a held key repeats. */
  async press(key) {
    if (this.isSending) return;
    this.isSending = true;
    this.mark(key);
    try {
      const headers = { ...authorization(this.token), "Content-Type": "application/json" };
      const response = await fetch("/control/press", { method: "POST", headers, body: JSON.stringify({ key }) });
      if (!response.ok) setText(this.text, (await response.json()).message);
    } catch {
      setText(this.text, "The server did not answer this key.");
    } finally {
      this.isSending = false;
    }
  }

  mark(key) {
    clearTimeout(this.timer);
    for (const button of this.buttons) setAttribute(button, "data-pressed", button.dataset.key === key ? "" : null);
    this.timer = setTimeout(() => this.mark(""), 200);
  }
}
