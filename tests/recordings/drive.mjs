// Packets and IMU samples of a simulated drive, for writers that are independent of nilio.
import { readFileSync } from "node:fs";

const kPacketBytes = 1206;
const kPacketsPerScan = 76;

/** Data packets of a classic capture of Ethernet frames: [{stamp (ns, BigInt), data}]. */
export function readPackets(path) {
  const file = readFileSync(path);
  const scale = file.readUInt32LE(0) === 0xa1b23c4d ? 1n : 1000n;
  const packets = [];
  for (let at = 24; at + 16 <= file.length; ) {
    const stamp = BigInt(file.readUInt32LE(at)) * 1_000_000_000n + BigInt(file.readUInt32LE(at + 4)) * scale;
    const length = file.readUInt32LE(at + 8);
    const data = file.subarray(at + 16 + 42, at + 16 + length);
    if (data.length === kPacketBytes) packets.push({ stamp, data });
    at += 16 + length;
  }
  return packets;
}

/** Frames of a log of candump -L: [{stamp, id, data}]. */
export function readFrames(path) {
  return readFileSync(path, "utf8")
    .trim()
    .split("\n")
    .map((line) => {
      const [, seconds, micros, id, data] = /^\((\d+)\.(\d+)\) \S+ ([0-9A-F]+)#([0-9A-F]*)/.exec(line);
      return { stamp: BigInt(seconds) * 1_000_000_000n + BigInt(micros) * 1000n, id: parseInt(id, 16), data: Buffer.from(data, "hex") };
    });
}

/** Packets as drivers publish them, some for each sweep: [{stamp of the last packet, packets}]. */
export function groupPackets(packets) {
  const groups = [];
  for (let i = 0; i < packets.length; i += kPacketsPerScan) {
    const group = packets.slice(i, i + kPacketsPerScan);
    groups.push({ stamp: group[group.length - 1].stamp, packets: group });
  }
  return groups;
}

/** Samples of an Xsens MTi (config/dbc): rates in 2^-9 rad/s, accelerations in 2^-8 m/s^2. */
export function imuSamples(frames) {
  const samples = [];
  let rate = null;
  const vector = (data, scale) => [0, 2, 4].map((at) => data.readInt16BE(at) * scale);
  for (const { stamp, id, data } of frames) {
    if (id === 0x32) rate = vector(data, 2 ** -9);
    if (id === 0x34 && rate) samples.push({ stamp, rate, force: vector(data, 2 ** -8) });
  }
  return samples;
}

// VLP-16 user manual: elevation of each channel and the height at which its beam leaves the axis, firings every
// 55.296 us, channels every 2.304 us.
const kElevations = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15];
const kHeights = kElevations.map((elevation) => -0.04191 * Math.tan((elevation * Math.PI) / 180));
const kRing = kElevations.map((elevation) => (elevation + 15) / 2);
const kHour = 3_600_000_000_000n;

/** Sweeps of a VLP-16 whose clock counts from the full hour: [{points: [x, y, z, intensity, ring, time ns]}]. */
export function sweeps(packets) {
  const all = [];
  let points = [];
  let last = -1;
  for (const { stamp, data } of packets) {
    const first = stamp - (stamp % kHour) + BigInt(data.readUInt32LE(1200)) * 1000n;
    for (let block = 0; block < 12; ++block) {
      const at = block * 100;
      const azimuth = data.readUInt16LE(at + 2);
      const next = block < 11 ? data.readUInt16LE(at + 102) : azimuth + ((azimuth - data.readUInt16LE(at - 98) + 36000) % 36000);
      const step = (next - azimuth + 36000) % 36000;
      if (last > azimuth && points.length > 0) {
        all.push({ points });
        points = [];
      }
      last = azimuth;
      for (let channel = 0; channel < 32; ++channel) {
        const range = data.readUInt16LE(at + 4 + 3 * channel) * 0.002;
        if (range === 0) continue;
        const firing = channel >> 4;
        const offset = 55296 * firing + 2304 * (channel & 15);
        const angle = ((azimuth + (step * offset) / 110592) * Math.PI) / 18000;
        const elevation = (kElevations[channel & 15] * Math.PI) / 180;
        const level = range * Math.cos(elevation);
        points.push([level * Math.cos(angle), -level * Math.sin(angle), range * Math.sin(elevation) + kHeights[channel & 15], data[at + 6 + 3 * channel],
          kRing[channel & 15], first + BigInt(110592 * block + offset)]);
      }
    }
  }
  return all;
}
