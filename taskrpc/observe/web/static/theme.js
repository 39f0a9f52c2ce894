// The button that switches between light and dark, and remembers the choice.

import { byId, icon, root, setAttribute, setIcon } from "./dom.js";

export function setUpTheme() {
  const button = byId("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  button.append(icon("dark"));
  const other = () => ((root.dataset.theme ?? (dark.matches ? "dark" : "light")) === "dark" ? "light" : "dark");
  const show = () => setIcon(button.firstChild, other());
  setAttribute(root, "data-theme", localStorage.getItem("taskrpc_theme"));
  dark.onchange = show;
  button.onclick = () => {
    root.dataset.theme = localStorage.taskrpc_theme = other();
    show();
  };
  show();
}
