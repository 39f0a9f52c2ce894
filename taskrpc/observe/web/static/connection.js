// Reads the server's event stream, reconnects, and keeps the token of this tab.

import { refusal } from "./words.js";

const SILENCE = 25_000; // milliseconds without a byte after which the connection counts as lost; the server sends one every 10 s
const WAITS = [300, 600, 1000, 2000, 3000, 5000]; // milliseconds before each attempt to reconnect
const HIDDEN = 5_000; // milliseconds until a hidden tab closes its stream, so that it costs the server nothing

/** Take the token out of the address bar (`#control=TOKEN`, `#view=TOKEN`) and keep it for this tab. */
export function takeToken() {
  const found = /^#(?:control|view)=([\w.~@+=/-]+)$/.exec(location.hash);
  if (found) {
    sessionStorage.setItem("taskrpc_token", found[1]);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem("taskrpc_token") ?? "";
}

/** Return the headers that show the token to the server. */
export const authorization = (token) => (token ? { Authorization: `Bearer ${token}` } : {});

/** Yields the parts of a response that end with a separator; `heard()` is called for each piece that arrives. */
export async function* partsOf(body, separator, heard = () => {}) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    heard();
    const parts = (text + value).split(separator);
    text = parts.pop();
    yield* parts;
  }
}

/** Yields the events of a stream of server-sent events as `[name, data]`. */
async function* events(body, heard) {
  for await (const block of partsOf(body, "\n\n", heard)) {
    const [, name, data] = /^event: (.*)\ndata: (.*)$/.exec(block) ?? [];
    if (name) yield [name, JSON.parse(data)];
  }
}

/**
 * The stream of `GET /live`. `receive(name, data)` gets each event; `report(state, text)` gets each
 * change of the connection: connecting, live, lost, refused or asleep.
 */
export class LiveStream {
  constructor(token, receive, report) {
    this.token = token;
    this.receive = receive;
    this.report = report;
    this.attempt = 0;
    this.stopped = false;
    this.abort = null; // ends the current request
    this.reason = ""; // why the server ends, if it said so
    document.addEventListener("visibilitychange", () => this.visibilityChanged());
    // A browser keeps the page for its Back button, and opens at most six connections to one server.
    addEventListener("pagehide", () => this.abort?.abort());
  }

  async run() {
    while (!this.stopped) {
      let problem = "";
      try {
        problem = await this.read();
      } catch (error) {
        problem = error.name === "AbortError" ? "" : "the server does not answer";
      }
      if (this.stopped) return;
      if (document.hidden) await this.untilVisible();
      else {
        if (problem !== "refused") this.report("lost", this.reason || problem || "the stream ended");
        const wait = problem === "refused" ? 5000 : WAITS[Math.min(this.attempt++, WAITS.length - 1)];
        await new Promise((resolve) => setTimeout(resolve, wait));
      }
    }
  }

  stop() {
    this.stopped = true;
    this.abort?.abort();
  }

  async read() {
    const abort = (this.abort = new AbortController());
    let timer;
    const heard = () => {
      clearTimeout(timer);
      timer = setTimeout(() => abort.abort(), SILENCE);
    };
    heard();
    try {
      const response = await fetch("/live", { headers: authorization(this.token), cache: "no-store", signal: abort.signal });
      if (!response.ok) {
        this.report("refused", refusal(response.status, (await response.text()).trim().slice(0, 200)));
        return "refused";
      }
      for await (const [name, data] of events(response.body, heard)) {
        if (name === "hello") {
          this.attempt = 0;
          this.reason = "";
          this.report("live", "");
        } else if (name === "ending") this.reason = data.reason;
        this.receive(name, data);
        if (this.stopped) break;
      }
      return "";
    } finally {
      clearTimeout(timer);
      abort.abort();
    }
  }

  visibilityChanged() {
    clearTimeout(this.sleep);
    if (!document.hidden) this.wake?.();
    else if (!this.stopped)
      this.sleep = setTimeout(() => {
        this.report("asleep", "");
        this.abort?.abort();
      }, HIDDEN);
  }

  untilVisible() {
    return new Promise((resolve) => {
      this.wake = resolve;
      if (!document.hidden) resolve();
    });
  }
}
