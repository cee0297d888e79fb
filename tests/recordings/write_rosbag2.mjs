// Writes a simulated drive as ROS 2 recordings, with npm's MCAP writer and CDR writer, and as SQL for sqlite3.
//
// node write_rosbag2.mjs DRIVE OUTPUT: OUTPUT/packets.mcap (zstd), packets_plain.mcap, packets.sql (packets and CAN
// frames), clouds.mcap (clouds with times before the stamp, IMU, /tf_static) and clouds.sql (absolute times).
import { MessageWriter } from "@foxglove/rosmsg2-serialization";
import { parse } from "@foxglove/rosmsg";
import { ros2humble } from "@foxglove/rosmsg-msgs-common";
import { McapWriter } from "@mcap/core";
import { FileHandleWritable } from "@mcap/nodejs";
import zstdModule from "@foxglove/wasm-zstd";
import { createWriteStream } from "node:fs";
import { open } from "node:fs/promises";
import { once } from "node:events";
import { groupPackets, imuSamples, readFrames, readPackets, sweeps } from "./drive.mjs";

const kHeader = "=".repeat(80) + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" +
  "=".repeat(80) + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const kScan = "std_msgs/Header header\nVelodynePacket[] packets\n" + "=".repeat(80) +
  "\nMSG: velodyne_msgs/VelodynePacket\nbuiltin_interfaces/Time stamp\nuint8[1206] data\n" + kHeader;
const kFrame = "std_msgs/Header header\nuint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data\n" + kHeader;

const time = (ns) => ({ sec: Number(ns / 1_000_000_000n), nanosec: Number(ns % 1_000_000_000n) });
const header = (ns, frame) => ({ stamp: time(ns), frame_id: frame });

/** Definitions of a published type with those that it needs. */
function definitionsOf(type) {
  const found = [];
  const visit = (name) => {
    const definition = ros2humble[name.replace("/msg/", "/")] ?? ros2humble[name];
    if (!definition || found.includes(definition)) return;
    found.push(definition);
    for (const field of definition.definitions) if (field.isComplex) visit(field.type);
  };
  visit(type);
  return found;
}

/** A topic: {name, type, text, write}. */
function topic(name, type, text) {
  const definitions = text ? parse(text, { ros2: true }) : definitionsOf(type);
  const writer = new MessageWriter(definitions);
  return { name, type, text: text ?? "", write: (message) => writer.writeMessage(message) };
}

function packetMessages(packets, frames) {
  const scans = topic("/velodyne_packets", "velodyne_msgs/msg/VelodyneScan", kScan);
  const can = topic("/can0", "can_msgs/msg/Frame", kFrame);
  const messages = groupPackets(packets).map(({ stamp, packets: group }) => ({
    topic: scans, stamp,
    data: scans.write({ header: header(stamp, "velodyne"), packets: group.map((p) => ({ stamp: time(p.stamp), data: p.data })) }),
  }));
  for (const { stamp, id, data } of frames)
    messages.push({ topic: can, stamp, data: can.write({ header: header(stamp, "can0"), id, is_rtr: false, is_extended: false,
      is_error: false, dlc: data.length, data: new Uint8Array([...data, ...new Uint8Array(8 - data.length)]) }) });
  return { topics: [scans, can], messages };
}

const kFloat32 = 7;
const kFloat64 = 8;
const kUint16 = 4;
const field = (name, offset, datatype) => ({ name, offset, datatype, count: 1 });

/** velodyne_pointcloud: the stamp is the time of the last point, and times count up to it. */
const kTimesBefore = {
  step: 22,
  fields: [field("x", 0, kFloat32), field("y", 4, kFloat32), field("z", 8, kFloat32), field("intensity", 12, kFloat32),
    field("ring", 16, kUint16), field("time", 18, kFloat32)],
  stamp: (points) => points[points.length - 1][5],
  write: (out, at, point, stamp) => {
    out.writeFloatLE(point[3], at + 12);
    out.writeUInt16LE(point[4], at + 16);
    out.writeFloatLE(Number(point[5] - stamp) * 1e-9, at + 18);
  },
};
/** Hesai: the stamp is the time of the first point, and times are absolute seconds. */
const kTimesAbsolute = {
  step: 26,
  fields: [field("x", 0, kFloat32), field("y", 4, kFloat32), field("z", 8, kFloat32), field("intensity", 12, kFloat32),
    field("ring", 16, kUint16), field("timestamp", 18, kFloat64)],
  stamp: (points) => points[0][5],
  write: (out, at, point) => {
    out.writeFloatLE(point[3], at + 12);
    out.writeUInt16LE(point[4], at + 16);
    out.writeDoubleLE(Number(point[5]) * 1e-9, at + 18);
  },
};

function cloudMessages(packets, frames, form) {
  const clouds = topic("/points", "sensor_msgs/msg/PointCloud2");
  const imu = topic("/imu/data", "sensor_msgs/msg/Imu");
  const tf = topic("/tf_static", "tf2_msgs/msg/TFMessage");
  const messages = [];
  for (const { points } of sweeps(packets)) {
    const stamp = form.stamp(points);
    const data = Buffer.alloc(points.length * form.step);
    points.forEach((point, i) => {
      for (let k = 0; k < 3; ++k) data.writeFloatLE(point[k], i * form.step + 4 * k);
      form.write(data, i * form.step, point, stamp);
    });
    messages.push({ topic: clouds, stamp: points[points.length - 1][5] + 2_000_000n,
      data: clouds.write({ header: header(stamp, "velodyne"), height: 1, width: points.length, fields: form.fields, is_bigendian: false,
        point_step: form.step, row_step: data.length, data, is_dense: true }) });
  }
  const vector = ([x, y, z]) => ({ x, y, z });
  const unknown = [-1, ...new Array(8).fill(0)];
  for (const { stamp, rate, force } of imuSamples(frames))
    messages.push({ topic: imu, stamp: stamp + 1_000_000n,
      data: imu.write({ header: header(stamp, "imu_link"), orientation: { x: 0, y: 0, z: 0, w: 0 }, orientation_covariance: unknown,
        angular_velocity: vector(rate), angular_velocity_covariance: new Array(9).fill(0),
        linear_acceleration: vector(force), linear_acceleration_covariance: new Array(9).fill(0) }) });
  // The mounting of the simulated vehicle (nilio.yaml): R = Rz(yaw) Ry(pitch) Rx(roll).
  const half = (degrees) => (degrees * Math.PI) / 360;
  const [r, p, y] = [half(0.5), half(-0.3), half(0.8)];
  const q = { x: Math.sin(r) * Math.cos(p) * Math.cos(y) - Math.cos(r) * Math.sin(p) * Math.sin(y),
    y: Math.cos(r) * Math.sin(p) * Math.cos(y) + Math.sin(r) * Math.cos(p) * Math.sin(y),
    z: Math.cos(r) * Math.cos(p) * Math.sin(y) - Math.sin(r) * Math.sin(p) * Math.cos(y),
    w: Math.cos(r) * Math.cos(p) * Math.cos(y) + Math.sin(r) * Math.sin(p) * Math.sin(y) };
  const first = packets[0].stamp;
  const mount = (child, translation, rotation) => ({ header: header(first, "base_link"), child_frame_id: child, transform: { translation, rotation } });
  messages.push({ topic: tf, stamp: first - 1n, data: tf.write({ transforms: [
    mount("velodyne", { x: 0, y: 0, z: 1.73 }, { x: 0, y: 0, z: 0, w: 1 }), mount("imu_link", { x: -0.81, y: 0.32, z: 0.93 }, q)] }) });
  return { topics: [clouds, imu, tf], messages };
}

const inOrder = ({ topics, messages }) => ({ topics, messages: messages.sort((a, b) => (a.stamp < b.stamp ? -1 : a.stamp > b.stamp ? 1 : 0)) });

async function writeMcap(path, { topics, messages }, compressChunk) {
  const file = await open(path, "w");
  const writer = new McapWriter({ writable: new FileHandleWritable(file), chunkSize: 768 * 1024, compressChunk });
  await writer.start({ profile: "ros2", library: "independent writer" });
  const channels = new Map();
  for (const { name, type, text } of topics) {
    const schemaId = await writer.registerSchema({ name: type, encoding: "ros2msg", data: new TextEncoder().encode(text) });
    channels.set(name, await writer.registerChannel({ schemaId, topic: name, messageEncoding: "cdr", metadata: new Map([["offered_qos_profiles", ""]]) }));
  }
  let sequence = 0;
  for (const { topic: { name }, stamp, data } of messages)
    await writer.addMessage({ channelId: channels.get(name), sequence: sequence++, logTime: stamp, publishTime: stamp, data });
  await writer.end();
  await file.close();
}

/** The schema of Foxy and Galactic. */
async function writeSql(path, { topics, messages }) {
  const sql = createWriteStream(path);
  sql.write("CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT NULL," +
    "offered_qos_profiles TEXT NOT NULL);\nCREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL," +
    "data BLOB NOT NULL);\nCREATE INDEX timestamp_idx ON messages (timestamp ASC);\nBEGIN;\n");
  topics.forEach(({ name, type }, i) => sql.write(`INSERT INTO topics VALUES(${i + 1},'${name}','${type}','cdr','');\n`));
  for (const { topic: of, stamp, data } of messages) {
    const line = `INSERT INTO messages(topic_id,timestamp,data) VALUES(${topics.indexOf(of) + 1},${stamp},X'${Buffer.from(data).toString("hex")}');\n`;
    if (!sql.write(line)) await once(sql, "drain");
  }
  sql.end("COMMIT;\n");
  await once(sql, "finish");
}

const [drive, output] = process.argv.slice(2);
await zstdModule.isLoaded;
const packets = readPackets(`${drive}/lidar.pcap`);
const frames = readFrames(`${drive}/imu.candump.log`);
const recorded = inOrder(packetMessages(packets, frames));
await writeMcap(`${output}/packets.mcap`, recorded, (chunk) => ({ compression: "zstd", compressedData: zstdModule.compress(chunk, 1) }));
await writeMcap(`${output}/packets_plain.mcap`, recorded);
await writeSql(`${output}/packets.sql`, recorded);
await writeMcap(`${output}/clouds.mcap`, inOrder(cloudMessages(packets, frames, kTimesBefore)));
await writeSql(`${output}/clouds.sql`, inOrder(cloudMessages(packets, frames, kTimesAbsolute)));
