// The workers: one runs the programs, and a spare one is ready for the next run.
//
// Each run begins in a new interpreter, as programs in a terminal do. Ending a worker also ends
// programs that never wait. A worker needs seconds to load, so the next one is loaded in advance.

import { query } from "./dom.js";

const STOP_PATIENCE = 2500; // milliseconds that programs get to stop by themselves
const SPARE_DELAY = 1500; // milliseconds of rest before the spare worker loads

// The page keeps the large files for its workers. A browser stores nothing of a site whose
// certificate the user accepted by hand, so each run would load them again.
const FILES = ["pyodide/pyodide.asm.wasm", "pyodide/python_stdlib.zip", "pyodide/pyodide-lock.json", "msgspec.whl", "yaml.zip", "taskrpc.zip"];

async function load(name) {
  const url = new URL(name, import.meta.url).href;
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${name}: ${response.status} ${response.statusText}`);
  return [url, await response.blob()];
}

const files = Promise.all(FILES.map(load));

class Interpreter {
  constructor(received) {
    this.received = received;
    this.queue = []; // the events that arrived before `listen` was called
    this.worker = new Worker(new URL(query.has("async") ? "worker.js?async" : "worker.js", import.meta.url), { type: "module" });
    this.worker.onmessage = ({ data }) => this.receive(JSON.parse(data));
    this.worker.onerror = (event) => this.receive({ event: "broken", text: event.message || "the worker could not be loaded" });
    files.then(
      (loaded) => this.worker.postMessage({ files: loaded }),
      (error) => this.receive({ event: "broken", text: String(error) }),
    );
  }

  receive(event) {
    if (this.received) this.received(event);
    else this.queue.push(event);
  }

  listen(received) {
    this.received = received;
    for (const event of this.queue.splice(0)) received(event);
  }

  ask(request) {
    this.worker.postMessage(JSON.stringify(request));
  }
}

export class Runtime {
  /** `received(event)` gets the events of the interpreter that is in use. */
  constructor(received) {
    this.received = received;
    this.current = null;
    this.spare = new Interpreter(null);
    this.is_used = false;
    this.begin();
  }

  /** Take the spare interpreter into use, and end the other one with all its programs. */
  begin() {
    this.current?.worker.terminate();
    clearTimeout(this.timer);
    const taken = this.spare ?? new Interpreter(null);
    this.spare = null;
    this.current = taken;
    this.is_used = this.is_ready = false;
    taken.ask({ do: "robot" });
    taken.listen((event) => {
      if (this.current !== taken) return;
      if (event.event === "ready") {
        this.is_ready = true;
        this.load_spare();
      }
      this.received(event);
    });
  }

  load_spare() {
    this.timer = setTimeout(() => (this.spare ??= new Interpreter(null)), SPARE_DELAY);
  }

  /** Ask an interpreter in which nothing has run yet. */
  ask_fresh(request) {
    if (this.is_used) this.begin();
    this.is_used = true;
    this.current.ask(request);
  }

  ask(request) {
    this.is_used ||= request.do === "start";
    this.current.ask(request);
  }

  /** Stop programs; `ended()` is called if that needed a new interpreter. */
  stop(programs, ended) {
    const asked = this.current;
    asked.ask({ do: "stop", programs });
    this.stopping = setTimeout(() => {
      if (this.current !== asked) return;
      this.begin();
      ended();
    }, STOP_PATIENCE);
  }

  stopped() {
    clearTimeout(this.stopping);
  }
}
