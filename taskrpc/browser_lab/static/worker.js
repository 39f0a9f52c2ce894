// The worker of the tab: it loads Pyodide and taskrpc, and passes requests to `tab/session.py`.

import { loadPyodide } from "./pyodide/pyodide.mjs";

const PACKAGES = "/lib/python3.14/site-packages";

const START = `
from taskrpc.browser_lab.tab import threads
from taskrpc.browser_lab.tab.session import Session
from taskrpc.ros import hook

scheduler = threads.install()
session = Session(scheduler, post)
session.open()
hook.install("/lab")
`;

const bytes = async (name) => {
  const response = await fetch(new URL(name, import.meta.url));
  if (!response.ok) throw new Error(`${name}: ${response.status} ${response.statusText}`);
  return response.arrayBuffer();
};

// With ?async the tab behaves as in a browser without stack switching: for tests and for teaching.
if (new URLSearchParams(location.search).has("async")) delete WebAssembly.Suspending;

const asked = [];
self.onmessage = ({ data }) => asked.push(data); // requests that come before Python listens

async function start() {
  const names = ["msgspec.whl", "yaml.zip", "taskrpc.zip"];
  const [python, ...archives] = await Promise.all([
    loadPyodide({ indexURL: new URL("./pyodide/", import.meta.url).href, env: { HOME: "/home", PYTHON_THREAD_INHERIT_CONTEXT: "1" } }),
    ...names.map(bytes),
  ]);
  for (const archive of archives) python.unpackArchive(archive, "zip", { extractDir: PACKAGES });
  python.globals.set("post", (text) => postMessage(text));
  await python.runPythonAsync(START);
  const ask = python.globals.get("session").ask;
  self.onmessage = ({ data }) => ask(data);
  asked.forEach((text) => ask(text));
}

start().catch((error) => postMessage(JSON.stringify({ event: "broken", text: String(error) })));
