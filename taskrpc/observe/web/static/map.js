// Draws the map: walls, places, the robot with its path, trail and newest scan.

import { DRAWING, byId, drawn, element, icon, isProjector, rem, setAttribute, setStyle, setText } from "./dom.js";
import { turnBetween } from "./model.js";
import { degrees } from "./words.js";

const SCAN_AGE = 6; // robot seconds that a scan is shown
const MARGIN = 12; // pixels around the floor
const FOOT = 24; // pixels below the floor, for the scale bar
const LABEL = 0.75; // rem, the size of the names of places; on a small map they get smaller
const LABEL_METRES = 0.5; // and have at most this height
const LABEL_LEAST = 0.45; // rem
const RAY_STEP = 6; // one ray of this many is drawn as a line

const points = (list) => list.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");

/** Return the drawing of a scan; `at` turns a point in metres into one of the drawing. */
export function scanShapes(scan, at) {
  const from = points([at([scan.x, scan.y])]);
  const ends = scan.ranges.map((range, i) => {
    const angle = scan.theta + scan.angle_min + i * scan.angle_increment;
    const reach = Number.isFinite(range) ? range : scan.range_max;
    return points([at([scan.x + reach * Math.cos(angle), scan.y + reach * Math.sin(angle)])]);
  });
  const rays = ends.filter((_, i) => i % RAY_STEP === 0).map((end) => `M${from}L${end}`);
  const hits = ends.filter((_, i) => scan.ranges[i] < scan.range_max).map((end) => `M${end}h0`);
  return [drawn("polygon.scan_area", { points: ends.join(" ") }), drawn("path.scan_rays", { d: rays.join("") }), drawn("path.scan_hits", { d: hits.join("") })];
}

/** Return whether a box and a convex polygon overlap: then no axis separates them. */
function overlaps({ left, right, top, bottom }, polygon) {
  const corners = [[left, top], [right, top], [right, bottom], [left, bottom]];
  const axes = [[1, 0], [0, 1], ...polygon.map(([x, y], i) => [polygon.at(i - 1)[1] - y, x - polygon.at(i - 1)[0]])];
  return axes.every(([x, y]) => {
    const [a, b] = [corners, polygon].map((shape) => shape.map((point) => point[0] * x + point[1] * y));
    return Math.max(...a) > Math.min(...b) && Math.max(...b) > Math.min(...a);
  });
}

/** Return the first of some boxes that covers least: `polygons` are walls and other labels. */
export function freest(boxes, polygons) {
  const cost = (box) => polygons.filter((polygon) => overlaps(box, polygon)).length;
  return boxes.reduce((best, box) => (cost(box) < cost(best) ? box : best));
}

export class MapView {
  /** `chosen(x, y)` gets the metres of a click on the floor. */
  constructor(model, chosen) {
    this.model = model;
    this.root = byId("map");
    this.floor = drawn("g");
    this.places = drawn("g");
    this.names = drawn("g.place_names");
    this.frames = drawn("g.frames");
    this.others = drawn("g.other_robots");
    this.fleet = element("ul#fleet", { hidden: true, "aria-label": "Robots" });
    this.scan = drawn("g.scan");
    this.trail = drawn("polyline.trail");
    this.path = drawn("polyline#path");
    this.goal = drawn("g#goal", drawn("circle", { r: 9 }), drawn("path", { d: "M-13 0h8M5 0h8M0-13v8M0 5v8" }));
    // A drawing of its own, so that the browser moves it without painting the map again.
    this.robot = drawn("svg#robot", DRAWING, { hidden: true });
    this.svg = drawn("svg#map_drawing", { role: "img", "aria-label": "Map" }, this.floor, this.places, this.scan, this.trail, this.path, this.goal, this.others, this.names, this.frames);
    this.hover = element("span.hover_text", DRAWING);
    this.empty = element("p.empty", "Waiting for the map.");
    this.root.before(this.fleet);
    this.root.append(this.svg, this.robot, this.hover, this.empty);
    this.battery = element("span#battery", icon("battery"), element("span"));
    this.pose = element("span#pose");
    this.odometer = element("span.minor#odometer");
    this.motion = element("strong#motion");
    byId("robot_text").append(this.motion, this.pose, this.odometer, this.battery);
    this.scale = 0;
    this.turn = 0; // of the drawing, clockwise; it counts on beyond a whole turn
    new ResizeObserver(([entry]) => this.resize(entry.contentRect)).observe(this.root);
    this.svg.addEventListener("pointermove", (event) => this.showPoint(event));
    this.svg.addEventListener("pointerleave", () => setText(this.hover, ""));
    this.svg.addEventListener("click", (event) => {
      const point = this.pointOf(event);
      if (point) chosen(...point);
    });
  }

  get map() {
    return this.model.hello?.map ?? null;
  }

  resize({ width, height }) {
    this.width = width;
    this.height = height;
    this.unit = rem() / 16; // pixels that one unit of a symbol has
    this.draw();
  }

  /** Redraw all that depends on the map or on the size. */
  draw() {
    const { map } = this;
    this.svg.toggleAttribute("hidden", !map);
    this.empty.hidden = Boolean(map);
    if (!map) {
      if (this.model.hello) setText(this.empty, "This robot has no map. Its pose is shown as numbers above.");
      return;
    }
    if (!(this.width > 40 && this.height > 40)) return;
    const [w, h] = map.size;
    const margin = MARGIN * this.unit;
    const foot = isProjector ? MARGIN : FOOT;
    this.scale = Math.min((this.width - 2 * margin) / w, (this.height - margin - foot) / h);
    this.left = (this.width - w * this.scale) / 2;
    this.bottom = (this.height + margin - foot + h * this.scale) / 2;
    this.drawFloor(map);
    this.drawPlaces(map);
    this.drawRobot(map);
    this.update(new Set(["path", "scan", "robot", "fleet", "frames"]));
  }

  at([x, y]) {
    return [this.left + x * this.scale, this.bottom - y * this.scale];
  }

  pointOf(event) {
    if (!this.map || !this.scale) return null;
    const box = this.root.getBoundingClientRect();
    const x = (event.clientX - box.left - this.left) / this.scale;
    const y = (this.bottom - (event.clientY - box.top)) / this.scale;
    const [w, h] = this.map.size;
    return x >= 0 && y >= 0 && x <= w && y <= h ? [x, y] : null;
  }

  showPoint(event) {
    const point = this.pointOf(event);
    const robot = this.model.pose();
    if (!point) return setText(this.hover, "");
    const near = robot && Math.hypot(point[0] - robot.x, point[1] - robot.y) < 0.5;
    const [x, y] = near ? [robot.x, robot.y] : point;
    setText(this.hover, `${near ? "robot  " : ""}x ${x.toFixed(2)}  y ${y.toFixed(2)}${near ? `  heading ${degrees(robot.theta)}` : ""}`);
  }

  drawFloor(map) {
    const [w, h] = map.size;
    const [left, top] = this.at([0, h]);
    const grid = [];
    const step = Math.max(w, h) > 40 ? 10 : Math.max(w, h) > 20 ? 5 : 1;
    for (let x = step; x < w; x += step) grid.push(`M${points([this.at([x, 0])])}V${top}`);
    for (let y = step; y < h; y += step) grid.push(`M${points([this.at([0, y])])}h${w * this.scale}`);
    const boxes = map.boxes.map((box) => drawn("polygon", { points: points(box.map((point) => this.at(point))) }));
    const [x, y] = this.at([0, 0]);
    const length = step * this.scale;
    this.floor.replaceChildren(
      drawn("rect.floor", { x: left, y: top, width: w * this.scale, height: h * this.scale, rx: 2 }),
      drawn("path.grid", { d: grid.join("") }),
      drawn("g.walls", ...boxes),
      drawn("path.scale_bar", { d: `M${x} ${y + 8}v6h${length}v-6` }),
      drawn("text.scale_text", { x: x + length + 8, y: y + 16 }, `${step} m`),
    );
  }

  drawPlaces(map) {
    const high = Math.max(map.radius * this.scale, 9 * this.unit) + 6 * this.unit; // above the robot
    const size = Math.max(LABEL_LEAST * rem(), Math.min(LABEL * rem(), LABEL_METRES * this.scale));
    this.svg.style.setProperty("--label", `${size.toFixed(1)}px`);
    const taken = map.boxes.map((box) => box.map((point) => this.at(point)));
    taken.push(...this.sides(map));
    const marks = [];
    const names = [];
    for (const point of Object.values(map.places)) taken.push(this.square(this.at(point)));
    for (const [name, point] of Object.entries(map.places)) {
      const [x, y] = this.at(point);
      const shape = name === "dock" ? drawn("path.dock", { d: "M-9-9h18v18h-18zM1-6-4 1h4l-1 5 5-7H0z" }) : drawn("path.place", { d: "M0-5 5 0 0 5-5 0z" });
      setAttribute(shape, "transform", `translate(${x} ${y}) scale(${this.unit})`);
      marks.push(shape);
      const label = drawn("text", { "text-anchor": "middle", "data-place": name }, name);
      this.names.append(label);
      const box = freest(this.boxesBeside(x, y, label.getComputedTextLength() + 0.5 * size, size, high), taken);
      setAttribute(label, "x", (box.left + box.right) / 2);
      setAttribute(label, "y", box.bottom - size * 0.25);
      taken.push([[box.left, box.top], [box.right, box.top], [box.right, box.bottom], [box.left, box.bottom]]);
      names.push(label);
    }
    this.places.replaceChildren(...marks);
    this.names.replaceChildren(...names);
  }

  /** Return where the name of a place may stand: above it, below it, and beside it. */
  boxesBeside(x, y, width, size, high) {
    const height = size * 1.15;
    const far = high + height / 2 - size * 0.25;
    const boxes = [];
    for (const more of [0, height]) {
      for (const shift of [0, 0.25, -0.25, 0.45, -0.45]) for (const up of [-1, 1]) boxes.push([x + shift * width, y + up * (far + more)]);
      for (const side of [1, -1]) boxes.push([x + side * (high + more + width / 2), y]);
    }
    return boxes.map(([cx, cy]) => ({ left: cx - width / 2, right: cx + width / 2, top: cy - height / 2, bottom: cy + height / 2 }));
  }

  /** Return the sides of the floor, as polygons of two points: a name may not cross them. */
  sides({ size: [w, h] }) {
    const corners = [[0, 0], [w, 0], [w, h], [0, h]].map((point) => this.at(point));
    return corners.map((corner, i) => [corner, corners.at(i - 1)]);
  }

  /** Return the square that the symbol of a place takes. */
  square([x, y]) {
    const r = 7 * this.unit;
    return [[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]];
  }

  drawRobot(map) {
    const r = Math.max(map.radius * this.scale, 8 * this.unit);
    const half = Math.ceil(r) + 2;
    setAttribute(this.robot, "viewBox", `${-half} ${-half} ${2 * half} ${2 * half}`);
    for (const name of ["width", "height"]) setAttribute(this.robot, name, 2 * half);
    this.half = half;
    this.robot.replaceChildren(
      drawn("circle.robot_body", { r }),
      drawn("path.robot_heading", { d: `M${r * 0.68} 0 ${-r * 0.42} ${-r * 0.5} ${-r * 0.12} 0 ${-r * 0.42} ${r * 0.5}z` }),
    );
  }

  update(changed) {
    if (changed.has("hello")) return this.draw();
    if (changed.has("robot") || changed.has("connection")) this.updateText();
    if (changed.has("fleet")) this.drawFleet();
    if (!this.scale) return;
    if (changed.has("path")) {
      const list = this.model.path.points;
      this.path.setAttribute("points", points(list.map((point) => this.at(point))));
      this.goal.toggleAttribute("hidden", list.length === 0);
      if (list.length) this.goal.setAttribute("transform", `translate(${points([this.at(list.at(-1))])}) scale(${this.unit})`);
    }
    if (changed.has("robot")) this.trail.setAttribute("points", points(this.model.trail.map((point) => this.at(point))));
    if (changed.has("scan")) this.drawScan();
    // A tree of frames without a map stands at the robot.
    if (changed.has("frames") || (changed.has("robot") && this.model.frames?.frames.length)) this.drawFrames();
  }

  updateText() {
    const { robot } = this.model;
    this.robot.toggleAttribute("hidden", !robot);
    this.battery.hidden = robot?.battery == null;
    this.odometer.hidden = robot?.odometer == null;
    this.motion.hidden = this.pose.hidden = !robot;
    if (!robot) return;
    setText(this.motion, this.model.isStale ? "last known" : robot.moving ? "moving" : "standing");
    setText(this.pose, `x ${robot.x.toFixed(2)}  y ${robot.y.toFixed(2)}  ${degrees(robot.theta)}`);
    if (robot.odometer != null) setText(this.odometer, `${robot.odometer.toFixed(1)} m driven`);
    if (robot.battery != null) setText(this.battery.lastChild, `${Math.round(robot.battery)} %`);
    setAttribute(this.battery, "data-low", robot.battery < 20);
    setAttribute(this.svg, "aria-label", `Map. The robot is at x ${robot.x.toFixed(1)}, y ${robot.y.toFixed(1)} and is ${robot.moving ? "moving" : "standing"}.`);
  }

  /** List the robots of a fleet, and draw the others that run on a map of this size. */
  drawFleet() {
    const robots = this.model.fleet?.robots ?? [];
    this.fleet.hidden = robots.length === 0;
    this.fleet.replaceChildren(...robots.map(({ name, state, what }) => element("li", `${name}: ${state}${what && ` ${what}`}`)));
    if (!this.scale) return;
    const others = robots.filter(({ own, state, x }) => !own && state !== "away" && x != null);
    const marks = others.flatMap(({ name, x, y }) => {
      const [cx, cy] = this.at([x, y]);
      return [drawn("circle", { cx, cy, r: 7 * this.unit }), drawn("text", { x: cx, y: cy + 20 * this.unit, "text-anchor": "middle" }, name)];
    });
    this.others.replaceChildren(...marks);
  }

  /** Draw the frames; most robots publish none. */
  async drawFrames() {
    if (!this.model.frames?.frames.length && !this.frames.hasChildNodes()) return;
    const { frameShapes, placedFrames } = await import("./frames.js");
    const placed = placedFrames(this.model.frames?.frames ?? [], this.model.robot);
    this.frames.replaceChildren(...frameShapes(placed, (point) => this.at(point), this.scale, this.unit, this.width / 2));
  }

  drawScan() {
    const { scan } = this.model;
    this.scan.replaceChildren(...(scan ? scanShapes(scan, (point) => this.at(point)) : []));
  }

  /** Move the robot; the style sheet lets it glide from one pose to the next. */
  frame(now) {
    const pose = this.model.pose();
    if (!pose || !this.scale) return;
    const [x, y] = this.at([pose.x, pose.y]);
    this.turn -= turnBetween(-this.turn, pose.theta); // the short way round, also across 180 degrees
    setStyle(this.robot, "transform", `translate(${(x - this.half).toFixed(1)}px, ${(y - this.half).toFixed(1)}px) rotate(${this.turn.toFixed(3)}rad)`);
    const { scan } = this.model;
    const age = scan ? (now - scan.t) * this.model.speed : Infinity;
    setStyle(this.scan, "opacity", String(Math.max(0, Math.min(1, Math.round((SCAN_AGE - age) * 20) / 20))));
  }
}
