// Turns values into the text that the page shows: durations, times of day, states, errors.

/** The tones of the states of a task; each state has an icon of its name. */
const TONES = {
  QUEUED: "quiet",
  RUNNING: "accent",
  PAUSED: "warn",
  CANCELING: "warn",
  SUCCEEDED: "good",
  FAILED: "bad",
  CANCELED: "quiet",
  INTERRUPTED: "violet",
};

export const stateOf = (state) => ({ word: state[0] + state.slice(1).toLowerCase(), tone: TONES[state] ?? "quiet" });

/** What an error code of a call means. */
const CODES = {
  DEADLINE_EXCEEDED: "no response before the deadline",
  PERMISSION_DENIED: "the caller's role does not allow it",
  INVALID_ARGUMENT: "the request is not valid",
  RESOURCE_EXHAUSTED: "the server is busy; try again later",
  UNAVAILABLE: "no server offers the service",
  TYPE_MISMATCH: "the service has another type",
  CANCELLED: "the caller cancelled it",
  INTERNAL: "the callback failed; see the server's log",
  UNAUTHENTICATED: "the token is not valid",
};

export const meaning = (code) => CODES[code] ?? "";

const clock = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit", second: "2-digit" });

/** Return the time of day of seconds since 1970: `14:03:07`. */
export const timeOfDay = (t) => clock.format(t * 1000);

/** Return a duration of some seconds as text: `3.6 s`, `2 min 5 s`, `1 h 2 min`. */
export function duration(seconds) {
  const s = Math.max(0, seconds);
  if (s < 9.95) return `${s.toFixed(1)} s`;
  if (s < 99.5) return `${Math.round(s)} s`;
  const whole = Math.round(s);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

/** Return whole seconds, for a text that counts: `4 s`, `2 min 5 s`. */
export const wholeSeconds = (seconds) => (seconds < 99.5 ? `${Math.max(0, Math.ceil(seconds))} s` : duration(seconds));

/** Return a difference with its sign: `+3.6 s`, `−12 s`. */
export const difference = (seconds) => `${seconds < 0 ? "−" : "+"}${duration(Math.abs(seconds))}`;

/** Return milliseconds with two digits: `0.31 ms`, `12 ms`, `1.2 s`. */
export function milliseconds(ms) {
  if (ms == null) return "–";
  if (ms >= 1000) return duration(ms / 1000);
  return `${ms < 10 ? ms.toFixed(ms < 1 ? 2 : 1) : Math.round(ms)} ms`;
}

export const degrees = (radians) => `${Math.round((((radians * 180) / Math.PI) % 360) + 360) % 360}°`;

/** Return `move to warehouse`, `scan at central`. */
export const taskText = (task) => `${task.task_type} ${task.target}`;

export const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;

/** Return `/list` for `/robot_task/list`, and the whole name of other services. */
export const shortName = (name, service) => (service && name.startsWith(`${service}/`) ? name.slice(service.length) : name);

/** Return when a call ended, Infinity for an open one. */
export const endOf = (call) => (call.state === "open" ? Infinity : call.begin + (call.ms ?? 0) / 1000);

/** Return how a call ended, as a short text: `0.31 ms`, `DEADLINE_EXCEEDED after 2.0 s`. */
export function callText(call, now) {
  const extra = (call.attempt > 1 ? ` · retry ${call.attempt - 1}` : "") + (call.repeated ? " · stored response" : "");
  if (call.state === "open") {
    const limit = call.deadline_ms == null ? "" : ` of ${milliseconds(call.deadline_ms)}`;
    return `open ${duration(now - call.begin)}${limit}${extra}`;
  }
  if (call.state === "error") return `${call.code || "error"} · ${milliseconds(call.ms)}${extra}`;
  return `${milliseconds(call.ms)}${extra}`;
}

/** Return the sentence for an HTTP status that refuses this page. */
export function refusal(status, message) {
  if (status === 401) return "This page has no valid token. Open the page with the command: taskrpc view, or with the link that the program printed";
  if (status === 403) return `The server refused this page: ${message || "its address is not one of the server's names"}`;
  return `The server answered with status ${status}${message ? `: ${message}` : ""}`;
}
