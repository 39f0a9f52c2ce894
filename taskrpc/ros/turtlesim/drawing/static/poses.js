// Lists the turtles with their poses and pens.

import { byId, element, setText, showEach } from "./dom.js";

const MOST = 12; // rows, so that the buttons below stay on the page

const row = () =>
  element("tr", element("th", { scope: "row" }), element("td.number"), element("td.number"), element("td.number"), element("td", element("span.pen"), element("span")));

export function showPoses(turtles) {
  byId("none").hidden = turtles.length > 0;
  showEach(byId("poses"), turtles.slice(0, MOST), row, (node, { name, x, y, theta, pen, width }) => {
    const [named, ...cells] = node.children;
    setText(named, name);
    named.title = name;
    [x, y, theta].forEach((value, i) => setText(cells[i], value.toFixed(2)));
    const [swatch, word] = cells[3].children;
    swatch.hidden = !pen;
    if (pen) {
      swatch.style.backgroundColor = `rgb(${pen.join(" ")})`;
      swatch.style.height = `${Math.min(Math.max(width, 4), 14)}px`;
    }
    setText(word, pen ? `${width} px` : "off");
  });
  setText(byId("more"), turtles.length > MOST ? `and ${turtles.length - MOST} more` : "");
}
