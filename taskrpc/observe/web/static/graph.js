// Draws the programs and the services between them: callers left, services in the middle, servers right.

import { DRAWING, byId, drawn, element, setText } from "./dom.js";
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

const isTopic = (name) => name.startsWith("t ");
const offersOf = (node) => [...node.services.map((name) => `s ${name}`), ...node.publishers.map((name) => `t ${name}`)];

export class GraphView {
  constructor(model) {
    this.model = model;
    this.root = byId("nodes");
    this.edges = drawn("svg.edges", DRAWING);
    this.columns = ["Callers", "Services and topics", "Servers"].map((title) => element("div.graph_column", element("h3", title)));
    this.more = element("p.more");
    this.empty = element("p.empty");
    this.graph = element("div.graph#graph", this.edges, ...this.columns);
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
    setText(this.empty, this.model.isRecording ? "No program yet." : "No program yet. Start one that calls a service: taskrpc-call /robot_task task_type=scan target=central priority=5");
    setText(this.more, graph?.more ? `and ${plural(graph.more, "more program")}` : "");
    const groups = groupsOf(nodes);
    const servers = nodes.map((node) => ({ node, offers: offersOf(node) })).filter(({ offers }) => offers.length);
    const used = new Set(groups.flatMap((group) => group.uses));
    const offered = servers.flatMap(({ offers }) => offers);
    const names = [...new Set([...offered.filter((name) => used.has(name)), ...used, ...offered])];
    const shown = names.slice(0, used.size > 2 * SERVICES ? SERVICES : Math.max(SERVICES, used.size));
    const middle = new Map(shown.map((name) => [name, this.middle(name)]));
    this.links = []; // the ends of each line: {from, to, name}
    const callers = groups.map(({ nodes, uses }) => this.callers(nodes, uses));
    const offering = servers.map(({ node }) => this.server(node));
    groups.forEach(({ uses }, i) => uses.forEach((name) => this.links.push({ from: callers[i], to: middle.get(name), name })));
    servers.forEach(({ offers }, i) => offers.forEach((name) => this.links.push({ from: middle.get(name), to: offering[i], name })));
    const rest = names.length - shown.length;
    const lists = [callers, [...middle.values(), rest ? element("p.more", `and ${rest} more`) : ""], offering];
    lists.forEach((list, i) => this.columns[i].replaceChildren(this.columns[i].firstChild, ...list));
    this.link();
  }

  callers(nodes, uses) {
    const names = nodes.slice(0, CHIPS).map((node) => element("span.chip", { title: node.program + (node.host && ` on ${node.host}`) }, node.name));
    const rest = nodes.length - names.length;
    return element("div.graph_box.callers", { "data-uses": uses.length }, ...names, rest ? element("span.chip.quiet", `and ${rest} more`) : null);
  }

  middle(name) {
    const kind = isTopic(name) ? "topic" : "service";
    return element(`div.graph_box.${kind}`, { title: kind }, name.slice(2), isTopic(name) ? element("span.quiet", " topic") : null);
  }

  server(node) {
    const { services, publishers } = node;
    const facts = [node.program, node.host, services.length && plural(services.length, "service"), publishers.length && plural(publishers.length, "topic")];
    return element("div.graph_box.server", element("strong", node.name), element("span.quiet", facts.filter(Boolean).join(" · ")));
  }

  /** Draw the lines; this reads the layout, so it runs only after a change. */
  link() {
    if (!this.links || this.root.hidden || !this.root.clientWidth) return;
    const frame = this.graph.getBoundingClientRect();
    const boxes = new Map([...this.graph.querySelectorAll(".graph_box")].map((node) => [node, node.getBoundingClientRect()]));
    const lines = this.links.filter(({ from, to }) => from && to).map(({ from, to, name }) => {
      const [a, b] = [boxes.get(from), boxes.get(to)];
      const [x1, y1, x2, y2] = [a.right - frame.left, a.top + a.height / 2 - frame.top, b.left - frame.left, b.top + b.height / 2 - frame.top].map(Math.round);
      const bend = (x2 - x1) / 2;
      return drawn(`path.edge${isTopic(name) ? ".topic" : ""}`, { d: `M${x1} ${y1}C${x1 + bend} ${y1} ${x2 - bend} ${y2} ${x2} ${y2}` });
    });
    this.edges.replaceChildren(...lines);
  }
}
