// Reads run.mcap with npm's MCAP and CDR readers: node read_run.mjs RUN.mcap [--cut]. Prints JSON: counts by topic,
// those of the statistics, problems. --cut: as a stream, up to where an unfinished file ends.
import { parse } from "@foxglove/rosmsg";
import { ros2humble } from "@foxglove/rosmsg-msgs-common";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";
import { readFileSync } from "node:fs";
import { open } from "node:fs/promises";

const [path, mode] = process.argv.slice(2);
const decompressHandlers = await loadDecompressHandlers();
const problems = [];
const counts = {};
const last = {};
let firstTime = null;
const odometry = [];
const readers = new Map();

const plain = (name) => (name ?? "").replace("/msg/", "/");
const shapeOf = ({ definitions }) => definitions.filter((f) => !f.isConstant)
  .map((f) => `${plain(f.type)}${f.isArray ? `[${f.arrayLength ?? ""}]` : ""} ${f.name}`).join("; ");

/** A definition has the fields of the published one of ROS 2 Humble, and so have all that it needs. */
function compare(schema, definitions) {
  for (const definition of definitions) {
    const name = plain(definition.name ?? schema.name);
    const published = ros2humble[name] ?? ros2humble[name.replace("/", "/msg/")];
    // ros2humble states time as a type of its own.
    if (name === "builtin_interfaces/Time") continue;
    if (!published) problems.push(`${schema.name}: ${name} is no published type`);
    else if (shapeOf(definition) !== shapeOf(published)) problems.push(`${name}: '${shapeOf(definition)}', published: '${shapeOf(published)}'`);
  }
}

function take(channel, schema, message) {
  if (!readers.has(schema.id)) {
    if (schema.encoding !== "ros2msg" || channel.messageEncoding !== "cdr") problems.push(`${channel.topic}: encodings ${schema.encoding}, ${channel.messageEncoding}`);
    if (!channel.metadata.get("offered_qos_profiles")) problems.push(`${channel.topic}: offered_qos_profiles is missing`);
    const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
    compare(schema, definitions);
    readers.set(schema.id, new MessageReader(definitions));
  }
  let decoded;
  try {
    decoded = readers.get(schema.id).readMessage(message.data);
  } catch (error) {
    problems.push(`${channel.topic}: message ${message.sequence}: ${error.message}`);
    return;
  }
  counts[channel.topic] = (counts[channel.topic] ?? 0) + 1;
  last[channel.topic] = decoded;
  firstTime ??= message.logTime;
  if (channel.topic === "/odom") odometry.push(decoded.pose.pose.position);
  if (channel.topic === "/scan_registered" && decoded.data.length !== decoded.width * decoded.height * decoded.point_step)
    problems.push(`/scan_registered: ${decoded.data.length} bytes of ${decoded.width} points`);
}

const result = { counts, problems };
if (mode === "--cut") {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(readFileSync(path));
  const schemas = new Map();
  const channels = new Map();
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type === "Message") {
      const channel = channels.get(record.channelId);
      take(channel, schemas.get(channel.schemaId), record);
    }
  }
} else {
  const file = await open(path);
  const reader = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(file), decompressHandlers });
  if (reader.header.profile !== "ros2") problems.push(`profile ${reader.header.profile}`);
  let time = 0n;
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    if (message.logTime < time) problems.push(`time goes back at ${message.logTime}`);
    time = message.logTime;
    const channel = reader.channelsById.get(message.channelId);
    take(channel, reader.schemasById.get(channel.schemaId), message);
  }
  result.statistics = {};
  for (const [id, count] of reader.statistics.channelMessageCounts) result.statistics[reader.channelsById.get(id).topic] = Number(count);
  result.chunks = reader.chunkIndexes.length;
  await file.close();
}
result.odometry = odometry.length > 0 ? odometry[odometry.length - 1] : null;
result.pathPoses = last["/path"]?.poses.length ?? 0;
result.frames = { odom: last["/odom"]?.header.frame_id, base: last["/odom"]?.child_frame_id, tf: last["/tf"]?.transforms[0]?.child_frame_id };
result.diagnostics = last["/diagnostics"]?.status.map((status) => status.name) ?? [];
console.log(JSON.stringify(result));
