// Source of finished runs: blocks inside this file (a report), or of the server.
import { Cloud, kinds, readHeader } from './clouds.js';
import { states, levels } from './palettes.js';

async function gunzip(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).arrayBuffer();
}

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; ++i) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

export const isReport = () => document.getElementById('runs') !== null;

async function block(id, token) {
  const inside = document.getElementById(id);
  if (inside) {
    const bytes = fromBase64(inside.textContent);
    inside.remove();
    return gunzip(bytes);
  }
  const response = await fetch(`/data/${id}`, token ? { headers: { authorization: `Bearer ${token}` } } : {});
  if (!response.ok) throw new Error(`${id}: ${response.status} ${response.statusText}`);
  return response.arrayBuffer();
}

function readTiles(buffer) {
  const view = new DataView(buffer);
  const tiles = new Map();
  for (let at = 0; at + 48 <= buffer.byteLength;) {
    const header = readHeader(view, at);
    if (!header || header.kind !== kinds.tile || header.data + 8 * header.count > buffer.byteLength) break;
    const cloud = new Cloud(header);
    cloud.replace(header, buffer);
    tiles.set(header.id, cloud);
    at = header.data + 8 * header.count;
  }
  return tiles;
}

function pathOf(poses) {
  const n = poses.t.length;
  const path = { count: n, xyz: new Float32Array(3 * n), time: Float64Array.from(poses.t) };
  for (let i = 0; i < n; ++i) {
    path.xyz[3 * i] = poses.x[i];
    path.xyz[3 * i + 1] = poses.y[i];
    path.xyz[3 * i + 2] = poses.z[i];
  }
  return path;
}

/** Index of the last time that is not after `t`. */
export function indexAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle - 1;
  }
  return low;
}

function prepare(run, tiles, name) {
  const path = pathOf(run.poses);
  const n = path.count;
  path.speed = new Float32Array(n);
  const scans = run.scans;
  const aligned = scans && scans.time_s.length > 0;
  if (aligned) {
    path.state = new Uint8Array(n);
    path.level = new Uint8Array(n);
    for (let i = 0; i < n; ++i) {
      const j = indexAt(scans.time_s, path.time[i] + 1e-4);
      path.state[i] = Math.max(0, states.indexOf(scans.state[j]));
      path.level[i] = Math.max(0, levels.indexOf(scans.degradation_level[j]));
      path.speed[i] = scans.speed_m_s[j];
    }
  } else {
    for (let i = 1; i < n; ++i) {
      const step = Math.hypot(...[0, 1, 2].map((k) => path.xyz[3 * i + k] - path.xyz[3 * i - 3 + k]));
      path.speed[i] = step / Math.max(path.time[i] - path.time[i - 1], 1e-3);
    }
    if (n > 1) path.speed[0] = path.speed[1];
  }
  if (run.errors) {
    path.error = new Float32Array(n);
    for (let i = 0; i < n; ++i) path.error[i] = run.errors.ape.m[indexAt(run.errors.ape.t, path.time[i] + 1e-4)];
  }
  return { name, run, path, tiles, truth: run.truth ? pathOf(run.truth) : null, duration: path.time[n - 1] };
}

export async function loadRuns(token) {
  const data = JSON.parse(new TextDecoder().decode(await block('runs', token)));
  const drives = [];
  const names = data.runs.map((run) => run.name);
  for (let i = 0; i < data.runs.length; ++i) {
    const tiles = readTiles(await block(`map${i}`, token));
    const name = names.indexOf(names[i]) === names.lastIndexOf(names[i]) ? names[i] : `${names[i]} (${i + 1})`;
    drives.push(prepare(data.runs[i], tiles, name));
  }
  return { version: data.version, drives };
}
