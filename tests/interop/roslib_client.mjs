// Uses everything of roslib that programs use, and prints what came back as JSON.
// Arguments: the folder node_modules, the package (roslib or roslib-1), the URL of the gateway.
import { createRequire } from "node:module";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, name, url] = process.argv.slice(2);
const isOld = name === "roslib-1";
const ROSLIB = isOld
  ? createRequire(join(modules, "x.js"))(name)
  : await import(pathToFileURL(join(modules, name, "dist", "RosLib.js")));
const plain = (value) => (isOld ? new ROSLIB.Message(value) : value);
const found = {};

const connected = () =>
  new Promise((resolve, reject) => {
    const ros = new ROSLIB.Ros({ url });
    ros.on("connection", () => resolve(ros));
    ros.on("error", reject);
  });
const wait = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
const ask = (target, method, ...given) =>
  new Promise((resolve, reject) => target[method](...given, resolve, reject));
const call = (ros, service, type, request) =>
  ask(new ROSLIB.Service({ ros, name: service, serviceType: type }), "callService", plain(request));

const ros = await connected();
const other = await connected();

// Services that programs offer
const task = { task_type: "move", target: "warehouse", priority: 8 };
found.submitted = await call(ros, "/robot_task", "my_robot_interfaces/RobotTask", task);
found.unknown = await call(ros, "/nothing", "std_srvs/Empty", {}).catch(String);
found.invalid = await call(ros, "/robot_task", "x/Y", { priority: "high" }).catch(String);

// What runs
found.topics = await ask(ros, "getTopics");
found.topicType = await ask(ros, "getTopicType", "/robot_task/pose");
found.topicsForType = await ask(ros, "getTopicsForType", "geometry_msgs/msg/PoseStamped");
found.services = await ask(ros, "getServices");
found.serviceType = await ask(ros, "getServiceType", "/robot_task");
found.servicesForType = await ask(ros, "getServicesForType", "my_robot_interfaces/srv/RobotTask");
found.request = await ask(ros, "getServiceRequestDetails", "my_robot_interfaces/srv/RobotTask");
found.response = await ask(ros, "getServiceResponseDetails", "my_robot_interfaces/srv/RobotTask");
found.nodes = await ask(ros, "getNodes");
found.actions = await ask(ros, "getActionServers");
found.params = await ask(ros, "getParams");
const definitions = await ask(ros, "getMessageDetails", "geometry_msgs/msg/Pose");
found.decoded = ros.decodeTypeDefs(definitions);
const node = await new Promise((resolve, reject) => {
  // The old version passes three lists.
  const done = (...given) => resolve(given.length > 1 ? { services: given[2] ?? given[0].services } : given[0]);
  ros.getNodeDetails("/task_server", done, reject);
});
found.nodeServices = node.services;

// A service that a client offers, called by another client
const add = { name: "/add_in_js", serviceType: "example_interfaces/AddTwoInts" };
const server = new ROSLIB.Service({ ros: other, ...add });
server.advertise((request, response) => {
  response.sum = request.a + request.b;
  return request.b >= 0;
});
await wait(0.5);
found.sum = await call(ros, add.name, add.serviceType, { a: 2, b: 3 });
found.failed = await call(ros, add.name, add.serviceType, { a: 2, b: -3 }).catch(String);
server.unadvertise();
await wait(0.5);
found.gone = await call(ros, add.name, add.serviceType, { a: 2, b: 3 }).catch(String);

// Actions: the old version has those of ROS 1 only
const goalOf = (action, goal, cancel = false) =>
  new Promise((resolve) => {
    const feedback = [];
    const end = (name) => (value) => resolve([name, value, feedback.length]);
    const id = action.sendGoal(goal, end("done"), (value) => feedback.push(value), end("failed"));
    if (cancel) setTimeout(() => action.cancelGoal(id), 500);
  });
if (!isOld) {
  const type = "my_robot_interfaces/action/ExecuteTask";
  const execute = new ROSLIB.Action({ ros, name: "/robot_task/execute", actionType: type });
  found.goal = await goalOf(execute, task);
  found.badGoal = await goalOf(execute, { priority: "high" });
  const fibonacci = { name: "/count_in_js", actionType: "example_interfaces/action/Fibonacci" };
  const counting = new ROSLIB.Action({ ros: other, ...fibonacci });
  counting.advertise(
    (goal, id) => {
      counting.sendFeedback(id, { sequence: [0, 1] });
      if (goal.order === 1) counting.setFailed(id);
      if (goal.order > 1 && goal.order < 9) counting.setSucceeded(id, { sequence: [0, 1, goal.order] });
    },
    (id) => counting.setCanceled(id, { sequence: [0] }),
  );
  await wait(0.5);
  const counter = new ROSLIB.Action({ ros, ...fibonacci });
  found.counted = await goalOf(counter, { order: 5 });
  found.failedGoal = await goalOf(counter, { order: 1 });
  found.cancelledGoal = await goalOf(counter, { order: 9 }, true);
  counting.unadvertise();
  await wait(0.5);
  found.goneAction = await goalOf(counter, { order: 5 });
}

// Topics
const chatter = { name: "/chatter", messageType: "std_msgs/String" };
const got = [];
const listener = new ROSLIB.Topic({ ros, ...chatter, queue_length: 10 });
listener.subscribe((message) => got.push(message.data));
const talker = new ROSLIB.Topic({ ros: other, ...chatter });
for (const data of ["one", "two", "Zürich ☃"]) talker.publish(plain({ data }));
await wait(1.5);
listener.unsubscribe();
await wait(0.3);
talker.publish(plain({ data: "late" }));
await wait(0.3);
found.chatter = got;
found.pose = await new Promise((resolve) => {
  const pose = new ROSLIB.Topic({
    ros, name: "/robot_task/pose", messageType: "geometry_msgs/PoseStamped", throttle_rate: 100,
  });
  pose.subscribe((message) => { pose.unsubscribe(); resolve(message); });
});

// Parameters of the ROS node that the test has started
const parameter = new ROSLIB.Param({ ros, name: "/talker:speed" });
{
  parameter.set(2, () => {});
  await wait(0.5);
  found.parameter = await ask(parameter, "get");
}

console.log(JSON.stringify(found));
ros.close();
other.close();
process.exit(0);
