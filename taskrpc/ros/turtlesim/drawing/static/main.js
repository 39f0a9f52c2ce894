// The page of turtlesim: connects the stream of events to the picture, the table and the keys.

import { LiveStream, takeToken } from "./connection.js";
import { byId, root, setAttribute, setText } from "./dom.js";
import { Keys } from "./keys.js";
import { Picture } from "./picture.js";
import { showPoses } from "./poses.js";
import { setUpTheme } from "./theme.js";
import { timeOfDay } from "./words.js";

const WORDS = { connecting: "connecting", live: "live", lost: "connection lost", refused: "refused", asleep: "asleep" };

const token = takeToken();
const picture = new Picture(byId("paper"), byId("lines"), byId("turtles"));
const keys = new Keys(token, byId("pad"), byId("drive_text"));
let connection = { state: "connecting", since: Date.now() / 1000 };

function receive(name, data) {
  if (name === "hello") {
    picture.begin(data);
    keys.begin(data.control);
  } else if (name === "turtles") {
    setText(byId("node"), data.title);
    document.title = `${data.title} · turtlesim`;
    picture.show(data);
    showPoses(data.turtles);
  } else if (name.startsWith("tile_")) picture.setTile(data);
}

function report(state, text) {
  if (state !== connection.state) connection = { state, since: Date.now() / 1000 };
  setAttribute(root, "data-connection", state);
  setAttribute(byId("connection"), "data-state", state);
  setText(byId("connection_text"), WORDS[state]);
  const since = timeOfDay(connection.since);
  let banner = "";
  if (state === "lost") banner = `Connection lost since ${since}: ${text}. The page shows the picture of that time, and reconnects by itself.`;
  if (state === "refused") banner = text;
  if (state === "asleep") banner = `This page has been asleep since ${since}, because its tab was hidden.`;
  setText(byId("banner"), banner);
  byId("banner").hidden = !banner;
  if (state !== "live") keys.stop();
}

setUpTheme();
new LiveStream(token, receive, report).run();
