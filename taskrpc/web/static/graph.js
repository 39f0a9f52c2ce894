// Draws the programs and the services between them: callers left, services in the middle, servers right.

import { byId, drawn, element } from "./dom.js";
import { plural } from "./words.js";

const CHIPS = 24; // most names that a group of callers shows
const SERVICES = 8; // most services in the middle

/** Return the groups of nodes that call and subscribe to the same names: `[{names, uses, nodes}]`. */
function groupsOf(nodes) {
  const groups = new Map();
  for (const node of nodes) {
    const uses = [...node.clients.map((name) => `s ${name}`), ...node.subscriptions.map((name) => `t ${name}`)].sort();
    if (!uses.length) continue;
    const key = uses.join("\n");
    if (!groups.has(key)) groups.set(key, { uses, nodes: [] });
    groups.get(key).nodes.push(node);
  }
  return [...groups.values()].sort((a, b) => b.nodes.length - a.nodes.length);
}

const offersOf = (node) => [...node.services.map((name) => `s ${name}`), ...node.publishers.map((name) => `t ${name}`)];

export class GraphView {
  constructor(model) {
    this.model = model;
    this.root = byId("nodes");
    this.edges = drawn("svg", { class: "edges", "aria-hidden": "true" });
    this.columns = ["Callers", "Services and topics", "Servers"].map((title) => element("div", { class: "graph_column" }, element("h3", {}, title)));
    this.more = element("p", { class: "more" });
    this.empty = element("p", { class: "empty" }, "No program yet. Start one that calls a service: taskrpc-call /robot_task task_type=scan target=central priority=5");
    this.graph = element("div", { class: "graph", id: "graph" }, this.edges, ...this.columns);
    this.root.append(this.graph, this.more, this.empty);
    new ResizeObserver(() => this.link()).observe(this.root);
  }

  update(changed) {
    if (changed.has("graph")) this.stale = true;
    if (this.stale && !this.root.hidden) this.draw();
  }

  draw() {
    this.stale = false;
    const { graph } = this.model;
    const nodes = graph?.nodes ?? [];
    this.graph.hidden = nodes.length === 0;
    this.empty.hidden = nodes.length > 0;
    this.more.textContent = graph?.more ? `and ${plural(graph.more, "more program")}` : "";
    const groups = groupsOf(nodes);
    const servers = nodes.filter((node) => node.services.length || node.publishers.length);
    const used = new Set(groups.flatMap((group) => group.uses));
    const offered = servers.flatMap(offersOf);
    const names = [...new Set([...offered.filter((name) => used.has(name)), ...used, ...offered])];
    const middle = names.slice(0, Math.max(SERVICES, used.size > 2 * SERVICES ? SERVICES : used.size));
    this.boxes = { callers: groups.map((group) => this.callers(group)), middle: middle.map((name) => this.middle(name)), servers: servers.map((node) => this.server(node)) };
    this.uses = groups.map((group) => group.uses);
    this.offers = servers.map(offersOf);
    this.names = middle;
    const rest = names.length - middle.length;
    const lists = [this.boxes.callers, [...this.boxes.middle, rest > 0 ? element("p", { class: "more" }, `and ${rest} more`) : null], this.boxes.servers];
    lists.forEach((list, i) => this.columns[i].replaceChildren(this.columns[i].firstChild, ...list.filter(Boolean)));
    this.link();
  }

  callers({ nodes, uses }) {
    const names = nodes.slice(0, CHIPS).map((node) => element("span", { class: "chip", title: `${node.program}${node.host ? ` on ${node.host}` : ""}` }, node.name));
    if (nodes.length > CHIPS) names.push(element("span", { class: "chip quiet" }, `and ${nodes.length - CHIPS} more`));
    return element("div", { class: "graph_box callers", "data-uses": uses.length }, ...names);
  }

  middle(name) {
    const isTopic = name.startsWith("t ");
    return element("div", { class: `graph_box ${isTopic ? "topic" : "service"}`, title: isTopic ? "topic" : "service" }, name.slice(2), isTopic ? element("span", { class: "quiet" }, " topic") : null);
  }

  server(node) {
    const facts = [node.program, node.host, node.services.length ? plural(node.services.length, "service") : "", node.publishers.length ? plural(node.publishers.length, "topic") : ""];
    return element("div", { class: "graph_box server" }, element("strong", {}, node.name), element("span", { class: "quiet" }, facts.filter(Boolean).join(" · ")));
  }

  /** Draw the lines; this reads the layout, so it runs only after a change. */
  link() {
    if (!this.boxes || this.root.hidden || !this.root.clientWidth) return;
    const frame = this.graph.getBoundingClientRect();
    const place = (box) => box.getBoundingClientRect();
    const middle = this.boxes.middle.map(place);
    const lines = [];
    const line = (fromX, fromY, toX, toY, isTopic) => {
      const bend = (toX - fromX) / 2;
      const [x1, y1, x2, y2] = [fromX - frame.left, fromY - frame.top, toX - frame.left, toY - frame.top].map(Math.round);
      lines.push(drawn("path", { class: isTopic ? "edge topic" : "edge", d: `M${x1} ${y1}C${x1 + bend} ${y1} ${x2 - bend} ${y2} ${x2} ${y2}` }));
    };
    const connect = (boxes, names, isCaller) =>
      boxes.map(place).forEach((box, i) => {
        for (const name of names[i]) {
          const at = middle[this.names.indexOf(name)];
          if (!at) continue;
          if (isCaller) line(box.right, box.top + box.height / 2, at.left, at.top + at.height / 2, name.startsWith("t "));
          else line(at.right, at.top + at.height / 2, box.left, box.top + box.height / 2, name.startsWith("t "));
        }
      });
    connect(this.boxes.callers, this.uses, true);
    connect(this.boxes.servers, this.offers, false);
    this.edges.replaceChildren(...lines);
  }
}
