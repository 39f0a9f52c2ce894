// Makes and changes elements. All text goes through textContent: a task's target may contain markup.

const SVG = "http://www.w3.org/2000/svg";

/** Return a new HTML element; `properties` are attributes, children are elements or text. */
export function element(tag, properties = {}, ...children) {
  return fill(document.createElement(tag), properties, children);
}

/** Return a new SVG element. */
export function drawn(tag, properties = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), properties, children);
}

function fill(node, properties, children) {
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child != null));
  return node;
}

export const byId = (id) => document.getElementById(id);

/** Set the text of a node, and do nothing if this function has set the same text before. */
export function setText(node, text) {
  if (node.shown !== text) node.textContent = node.shown = text;
}

/** Set a property of an element's style, unless this function has set the same value before. */
export function setStyle(node, name, value) {
  node.styled ??= {};
  if (node.styled[name] !== value) node.style[name] = node.styled[name] = value;
}

/** Set an attribute, or remove it for null, and do nothing if it is so already. */
export function setAttribute(node, name, value) {
  if (value == null) node.removeAttribute(name);
  else if (node.getAttribute(name) !== String(value)) node.setAttribute(name, value);
}

/** Return the drawing of one of the symbols in index.html. */
export function icon(name) {
  return drawn("svg", { class: "icon", viewBox: "0 0 16 16", "aria-hidden": "true", "data-icon": name }, drawn("use", { href: `#icon_${name}` }));
}

/** Change which symbol an icon shows. */
export function setIcon(node, name) {
  if (node.dataset.icon === name) return;
  node.dataset.icon = name;
  node.firstChild.setAttribute("href", `#icon_${name}`);
}

/** Return a command line with a button that copies it. */
export function command(text) {
  const button = element("button", { type: "button", class: "copy", "aria-label": `Copy: ${text}` }, "Copy");
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(button.previousSibling);
      button.textContent = "Selected";
    }
    setTimeout(() => (button.textContent = "Copy"), 1500);
  });
  return element("span", { class: "command" }, element("code", {}, text), button);
}

export const calm = matchMedia("(prefers-reduced-motion: reduce)");

/** Animate an element once, unless the user asked for reduced motion. */
export function animate(node, frames, duration = 200) {
  if (!calm.matches) node.animate(frames, { duration, easing: "ease-out" });
}
