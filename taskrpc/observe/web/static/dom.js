// Makes and changes elements. All text goes through textContent: a task's target may contain markup.

/** The root element; its data attributes say how the style sheet draws the page. */
export const root = document.documentElement;
export const byId = (id) => document.getElementById(id);
export const query = new URLSearchParams(location.search);
export const isProjector = query.has("projector");
export const calm = matchMedia("(prefers-reduced-motion: reduce)");

/** Attributes of a part that screen readers skip. */
export const DRAWING = { "aria-hidden": "true" };

/** Return the size of the root's text in pixels: one rem. */
export const rem = () => parseFloat(getComputedStyle(root).fontSize);

/**
 * Return a new HTML element: `element("p.quiet#id", {title: "a title"}, "text", child)`. The parts
 * are attributes (`onNAME` listens to an event), text and children; null is left out.
 */
export function element(name, ...parts) {
  return make((tag) => document.createElement(tag), name, parts);
}

/** Return a new SVG element; the parts are those of `element`. */
export function drawn(name, ...parts) {
  return make((tag) => document.createElementNS("http://www.w3.org/2000/svg", tag), name, parts);
}

function make(create, name, parts) {
  const [tag, ...marks] = name.split(/(?=[.#])/);
  const node = create(tag);
  for (const mark of marks) {
    if (mark[0] === "#") node.id = mark.slice(1);
    else node.classList.add(mark.slice(1));
  }
  for (const part of parts) {
    if (part?.constructor === Object) setAll(node, part);
    else if (part != null) node.append(part);
  }
  return node;
}

function setAll(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== false) setAttribute(node, name, value === true ? "" : value);
  }
}

/** Give a list as many children as there are values, and show each value in its child. */
export function showEach(list, values, made, show) {
  while (list.children.length > values.length) list.lastChild.remove();
  while (list.children.length < values.length) list.append(made());
  values.forEach((value, i) => show(list.children[i], value, i));
}

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
  return drawn("svg.icon", DRAWING, { viewBox: "0 0 16 16", "data-icon": name }, drawn("use", { href: `#icon_${name}` }));
}

/** Change which symbol an icon shows. */
export function setIcon(node, name) {
  if (node.dataset.icon === name) return;
  node.dataset.icon = name;
  node.firstChild.setAttribute("href", `#icon_${name}`);
}

/** Return a command line with a button that copies it. */
export function command(text) {
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(button.previousSibling);
      button.textContent = "Selected";
    }
    setTimeout(() => (button.textContent = "Copy"), 1500);
  };
  const button = element("button.copy", { "aria-label": `Copy: ${text}`, onclick: copy }, "Copy");
  return element("span.command", element("code", text), button);
}

/** Let a click beside a dialog close it; return its head with a title and a button that closes it. */
export function dialogHead(dialog, id, title) {
  dialog.onclick = (event) => event.target === dialog && dialog.close();
  return element("header", element(`h2#${id}`, title), element("button.icon_button", { "aria-label": "Close", onclick: () => dialog.close() }, "✕"));
}

/** Animate an element once, and return the animation; undefined if the user asked for reduced motion. */
export function animate(node, frames, duration = 200) {
  if (!calm.matches) return node.animate(frames, { duration, easing: "ease-out" });
}

/** The frames of an element that appears. */
export const APPEARS = [{ opacity: 0 }, { opacity: 1 }];
