// Computes where the frames of /tf and /tf_static are on the map, and draws their axes and names.

import { drawn } from "./dom.js";

const WORLD = ["map", "world", "odom"]; // a tree with one of these roots is at the map's origin, any other at the robot
const AXIS = 0.4; // metres of an axis, within these pixels:
const SHORTEST = 12;
const LONGEST = 36;
const NEAR = 26; // pixels between two names; nearer frames share one

/** Return a vector, rotated by a unit quaternion [x, y, z, w]. */
export function rotated([x, y, z, w], [a, b, c]) {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}

const plus = (a, b) => a.map((value, i) => value + b[i]);

/** Return the frames with their origin and the directions of x and y in the map; those in a circle are left out. */
export function placedFrames(frames, robot) {
  const known = new Map(frames.map((frame) => [frame.name, frame]));
  const roots = new Set(frames.map(({ parent }) => parent).filter((parent) => !known.has(parent)));
  const half = (robot?.theta ?? 0) / 2;
  const standing = { at: [robot?.x ?? 0, robot?.y ?? 0, 0], turn: [0, 0, Math.sin(half), Math.cos(half)] };
  const placed = [];
  for (const name of [...roots, ...known.keys()]) {
    let origin = [0, 0, 0];
    let axes = [[1, 0, 0], [0, 1, 0]];
    const move = ({ at, turn }) => {
      origin = plus(rotated(turn, origin), at);
      axes = axes.map((axis) => rotated(turn, axis));
    };
    let top = name;
    for (let depth = 0; known.has(top) && depth <= known.size; depth += 1) {
      move(known.get(top));
      top = known.get(top).parent;
    }
    if (known.has(top)) continue;
    if (!WORLD.includes(top)) move(standing);
    placed.push({ name, origin, axes });
  }
  return placed;
}

/** Return the drawing of placed frames; `at` turns metres into a point of the drawing, `scale` is the pixels of a metre, `middle` the x from which on names stand at the left. */
export function frameShapes(placed, at, scale, unit, middle) {
  const length = Math.max(SHORTEST * unit, Math.min(LONGEST * unit, AXIS * scale));
  const shapes = [];
  const labels = [];
  for (const { name, origin, axes } of placed) {
    const [x, y] = at(origin);
    axes.forEach(([a, b], i) => shapes.push(drawn(i ? "path.axis_y" : "path.axis_x", { d: `M${x.toFixed(1)} ${y.toFixed(1)}l${(a * length).toFixed(1)} ${(-b * length).toFixed(1)}` })));
    const near = labels.find((label) => Math.hypot(label.x - x, label.y - y) < NEAR * unit);
    if (near) near.names.push(name);
    else labels.push({ x, y, names: [name] });
  }
  const texts = labels.map(({ x, y, names: [first, ...others] }) =>
    drawn("text", { x: x + (x > middle ? -4 : 4) * unit, y: y - 5 * unit, "text-anchor": x > middle ? "end" : "start" }, others.length ? `${first} +${others.length}` : first, drawn("title", {}, [first, ...others].join("\n"))));
  return [...shapes, ...texts];
}
