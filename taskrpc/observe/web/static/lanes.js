// The swim lanes of the sequence diagram: names at the left, the track, the newest text at the right.

import { DRAWING, drawn, element, isProjector, rem, root as page, setAttribute, setText, showEach } from "./dom.js";

const LANE = 1.75; // rem, the least height of a lane
const LANE_PROJECTOR = 1.125; // rem, the least height where the text is twice as large
const LANE_MOST = 4.5; // rem
const TOP = 0.5; // rem above the first lane, for its labels; as in style.css
const IDLE = 12; // seconds after which a client's lane may go to another client

export const SERVER = "server";
export const QUEUE = "queue";
export const ROBOT = "robot";

/** Assigns lanes to clients and draws their frame; the track in between is for the caller. */
export class Lanes {
  constructor(root, label) {
    this.names = element("ol.lane_names", DRAWING);
    this.lasts = element("ol.lane_lasts", DRAWING);
    this.lines = drawn("svg.lane_lines", DRAWING);
    this.track = element("div.track", this.lines);
    this.frame = element("div.lanes", { role: "img", "aria-label": label }, this.names, this.track, this.lasts);
    root.append(this.frame);
    this.clients = []; // [{name, seen}], in the order of their lanes
    this.others = new Map(); // client without a lane -> when it called
    this.most = 2; // lanes of clients that there is room for
    this.revision = 0; // counts the changes of the lanes
    this.ready = false; // whether the panel is shown and large enough
  }

  /** The lanes below those of the clients; a page that has only calls knows no queue and no robot. */
  get fixed() {
    return "calls_only" in page.dataset ? [SERVER] : [SERVER, QUEUE, ROBOT];
  }

  /** Take the size of the panel, in pixels; return whether it can be drawn. */
  resize(width, height) {
    if (width < 100 || height < 60) return (this.ready = false);
    this.rem = rem();
    this.width = width;
    this.height = height;
    const least = isProjector ? LANE_PROJECTOR : LANE;
    this.most = Math.max(2, Math.floor((height - TOP * this.rem) / (least * this.rem)) - this.fixed.length);
    this.makeRoom();
    this.layout();
    return (this.ready = true);
  }

  clear() {
    this.clients = [];
    this.others.clear();
    this.layout();
  }

  /** Note that a client is active at `t`; the client gets a lane if one is free. */
  see(name, t) {
    const known = this.clients.find((client) => client.name === name);
    if (known) {
      known.seen = Math.max(known.seen, t);
      return;
    }
    const isOther = this.others.has(name);
    const idle = isOther ? -1 : this.clients.findIndex((client) => t - client.seen > IDLE);
    if (idle < 0 && this.others.size) {
      // The lanes stay as they are, so the drawing stays too; only the number of the others grows.
      this.others.set(name, t);
      if (!isOther) this.countOthers();
      return;
    }
    if (idle >= 0) this.clients[idle] = { name, seen: t };
    else this.clients.push({ name, seen: t });
    this.makeRoom();
    this.layout();
  }

  /** Give each client a lane; if there are too many, the last lane is for all that have none. */
  makeRoom() {
    const all = [...this.clients, ...[...this.others].map(([name, seen]) => ({ name, seen }))];
    this.clients = all.length <= this.most ? all : all.slice(0, this.most - 1);
    this.others = new Map(all.slice(this.clients.length).map(({ name, seen }) => [name, seen]));
  }

  /** Forget the clients without a lane that are idle. */
  forget(now) {
    if (!this.others.size) return;
    for (const [name, seen] of this.others) if (now - seen > IDLE) this.others.delete(name);
    if (this.others.size) return this.countOthers();
    this.layout();
  }

  countOthers() {
    if (this.ready) setText(this.names.children[this.clients.length].firstChild, `${this.others.size} more`);
  }

  layout() {
    this.revision++;
    const rows = this.clients.map((client) => [client.name, "client"]);
    if (this.others.size) rows.push([`${this.others.size} more`, "others"]);
    rows.push(...this.fixed.map((name) => [name, name]));
    this.rows = rows;
    if (!this.height) return;
    this.top = TOP * this.rem;
    this.lane = Math.min((this.height - this.top) / rows.length, LANE_MOST * this.rem);
    this.index = new Map(this.clients.map((client, i) => [client.name, i]));
    const fixed = rows.length - this.fixed.length;
    this.server = this.middle(fixed);
    this.queue = this.middle(fixed + 1);
    this.robot = this.middle(fixed + 2);
    this.other = this.middle(fixed - 1);
    this.frame.style.setProperty("--lane", `${this.lane}px`);
    const show = (list, texts) => showEach(list, rows, () => element("li", element("span"), element("span")), (node, [name, kind]) => {
      setText(node.firstChild, texts ? name : "");
      setText(node.lastChild, "");
      setAttribute(node, "data-kind", kind);
      setAttribute(node, "data-tone", null);
    });
    show(this.names, true);
    show(this.lasts, false);
    this.lines.replaceChildren(...rows.map((_, i) => drawn("path", { d: `M0 ${this.middle(i)}H${this.width}` })));
  }

  middle(i) {
    return this.top + (i + 0.5) * this.lane;
  }

  /** Return the y of a client's lane. */
  y(client) {
    const i = this.index.get(client);
    return i === undefined ? this.other : this.middle(i);
  }

  /** Show two texts at the right end of a lane; `row` counts from the top, negative from the bottom. */
  last(row, first, second = "", tone = null) {
    const node = [...this.lasts.children].at(row);
    if (!node) return;
    setText(node.firstChild, first);
    setText(node.lastChild, second);
    setAttribute(node, "data-tone", tone);
  }
}
