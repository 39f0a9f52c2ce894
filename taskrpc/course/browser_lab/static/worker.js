// The worker of the tab: it loads Pyodide and taskrpc, and passes requests to `tab/session.py`.

import { loadPyodide } from "./pyodide/pyodide.mjs";

const PACKAGES = "/lib/python3.14/site-packages";

const START = `
from taskrpc.course.browser_lab.tab import threads
from taskrpc.course.browser_lab.tab.session import Session
from taskrpc.ros import hook

scheduler = threads.install()
session = Session(scheduler, post)
session.open()
hook.install("/lab")
`;

const bytes = async (name) => (await fetch(new URL(name, import.meta.url))).arrayBuffer();

// With ?async the tab behaves as in a browser without stack switching: for tests and for teaching.
if (new URLSearchParams(location.search).has("async")) delete WebAssembly.Suspending;

const asked = [];
let take;
const files = new Promise((resolve) => (take = resolve));
// The page sends the large files, and requests that come before Python listens.
self.onmessage = ({ data }) => (data.files ? take(new Map(data.files)) : asked.push(data));

const download = self.fetch;
// Pyodide gets its files with `fetch`; those that the page has loaded come from there.
self.fetch = async (resource, options) => {
  const kept = (await files).get(new URL(resource.url ?? resource, import.meta.url).href);
  return kept ? new Response(kept) : download(resource, options);
};

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
