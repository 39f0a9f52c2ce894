// Shows the notes of a recorded simulation: its faults and its failure on the lanes, the newest lines beside the tabs.

import { byId, drawn, setText } from "./dom.js";

const TOGETHER = 0.001; // seconds between notes that are shown together
const RADIUS = 0.28; // rem, half of the side of a mark, which is a square on its corner
const NEAR = 10; // pixels around a mark that still count as the mark
const LETTER = 0.42; // rem, the width of a letter of a label

/** Return what happened: `gripper prints: grasping`. */
export function noteText({ program, kind, text }) {
  if (kind === "fault") return `FAULT: ${text}`;
  if (kind === "failure") return `FAILED: ${text}`;
  return `${program} ${{ print: "prints: ", raise: "ends with " }[kind] ?? ""}${text}`;
}

/** Return when it happened, from the begin of the run: `1.100 s`. */
export const momentText = (seconds) => `${seconds.toFixed(3)} s`;

export class NotesView {
  /** `calls` draws the lanes. */
  constructor(recording, calls) {
    this.recording = recording;
    this.notes = recording.named.note.map(({ t, data }) => ({ ...data, t })); // oldest first
    this.calls = calls;
    this.lanes = calls.lanes;
    this.text = byId("message_text");
    this.marks = drawn("g");
    calls.moving.append(this.marks);
    this.lanes.track.addEventListener("pointermove", (event) => this.point(event));
    this.shown = ""; // what the drawing depends on
  }

  frame() {
    const count = this.count();
    if (!this.calls.stopped) setText(this.text, this.newest(count));
    if (!this.calls.isShown || !this.lanes.ready) return;
    const { origin, lanes } = this.calls;
    const shown = [origin, lanes.revision, count].join();
    if (shown === this.shown) return;
    this.shown = shown;
    this.draw(this.notes.slice(0, count).filter((note) => note.tone && note.t > origin));
  }

  /** Return how many notes there are up to now. */
  count() {
    const count = this.notes.findIndex(({ t }) => t > this.recording.clock.t);
    return count < 0 ? this.notes.length : count;
  }

  /** Return the newest notes with their time, and where they come from. */
  newest(count) {
    if (!count) return "";
    const { t } = this.notes[count - 1];
    const words = (note) => noteText(note) + (note.where && ` (${note.where})`);
    const together = this.notes.slice(Math.max(0, count - 20), count).filter((note) => t - note.t < TOGETHER);
    const failures = together.filter(({ kind }) => kind === "failure"); // there may be no room for more
    const texts = (failures.length ? failures : together).map(words);
    return `${momentText(t - this.recording.begin)}  ${texts.join(" · ")}`;
  }

  /** Return the y of a note: the lane of its program, or that of the services. */
  y({ program }) {
    const { index, others, server } = this.lanes;
    return index.has(program) || others.has(program) ? this.lanes.y(program) : server;
  }

  draw(notes) {
    const r = RADIUS * this.lanes.rem;
    const ends = new Map(); // y of a lane -> x of the right end of its last mark
    this.marks.replaceChildren(...notes.map((note) => {
      const x = this.calls.x(note.t);
      const y = this.y(note);
      const isFailure = note.kind === "failure";
      const label = isFailure || note.kind === "fault" ? note.text : noteText(note);
      const right = x - 2.5 * r;
      const line = isFailure ? y + 0.35 * this.lanes.lane : y; // a failure is often right after a fault
      const hasRoom = right - label.length * LETTER * this.lanes.rem > (ends.get(line) ?? -Infinity);
      ends.set(line, x + r);
      return drawn("g.notable.note", { "data-tone": note.tone, "data-kind": note.kind },
        isFailure ? drawn("path.deadline", { d: `M${x} 0V${this.lanes.height}` }) : null,
        drawn("rect", { x: x - r, y: y - r, width: 2 * r, height: 2 * r, transform: `rotate(45 ${x} ${y})` }),
        // At the left of its mark: it is read at once when a mark appears at the right.
        hasRoom ? drawn("text", { x: right, y: line, "text-anchor": "end", "dominant-baseline": "central" }, isFailure ? `✕ ${label}` : label) : null);
    }));
  }

  /** Show the tooltip of the marks under the pointer, in place of that of a call. */
  point({ clientX, clientY }) {
    if (!this.calls.isShown || !this.lanes.ready) return;
    const { right, top } = this.lanes.track.getBoundingClientRect();
    const { pixels, tooltip } = this.calls;
    const t = this.recording.clock.t - (right - clientX) / pixels;
    const isNear = (note) => note.tone && Math.abs(note.t - t) * pixels <= NEAR && (note.kind === "failure" || Math.abs(this.y(note) + top - clientY) <= NEAR);
    const found = this.notes.slice(0, this.count()).filter(isNear);
    if (!found.length) return;
    tooltip.hidden = false;
    setText(tooltip, found.map((note) => `${momentText(note.t - this.recording.begin)}: ${noteText(note)}`).join("\n"));
    tooltip.style.transform = `translate(${Math.min(clientX, innerWidth - 280)}px, ${clientY - 16}px) translateY(-100%)`;
  }
}
