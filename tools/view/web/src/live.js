// Source of a live drive: a WebSocket that reconnects by itself. Text is state, binary is clouds and path.
import { Cloud, kinds, readHeader } from './clouds.js';

const kSilentMs = 2000;
const kRetryMs = [250, 500, 1000];
const kRows = 1200;

/** A path that grows; typed arrays of doubling capacity. */
export class GrowingPath {
  constructor() {
    this.room = 0;
    this.count = 0;
    this.reserve(1024);
  }

  reserve(count) {
    if (count <= this.room) return;
    const room = Math.max(count, this.room * 2);
    const grow = (Type, old, stride) => {
      const array = new Type(room * stride);
      if (old) array.set(old.subarray(0, this.count * stride));
      return array;
    };
    this.xyz = grow(Float32Array, this.xyz, 3);
    this.time = grow(Float64Array, this.time, 1);
    this.speed = grow(Float32Array, this.speed, 1);
    this.state = grow(Uint8Array, this.state, 1);
    this.level = grow(Uint8Array, this.level, 1);
    this.room = room;
  }

  add(view, header) {
    if (header.id === 0) this.count = 0;
    this.reserve(this.count + header.count);
    for (let i = 0, at = header.data; i < header.count; ++i, at += 32) {
      const n = this.count++;
      this.time[n] = view.getFloat64(at, true);
      for (let k = 0; k < 3; ++k) this.xyz[3 * n + k] = view.getFloat32(at + 8 + 4 * k, true);
      this.speed[n] = view.getFloat32(at + 20, true);
      this.state[n] = view.getUint8(at + 24);
      this.level[n] = view.getUint8(at + 25);
    }
  }
}

export class LiveSource {
  /** `handlers`: hello, state, summary, rows, events, scan, tile, path, drive, link. */
  constructor(handlers, token) {
    this.handlers = handlers;
    this.token = token;
    this.attempt = 0;
    this.rows = [];
    this.connect();
    this.watch = setInterval(() => this.check(), 250);
  }

  connect() {
    this.reset();
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = new WebSocket(`${scheme}://${location.host}/`, 'nilio-view');
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    this.heardAt = performance.now();
    socket.onopen = () => { if (this.token) socket.send(this.token); };
    socket.onmessage = (event) => {
      this.heardAt = performance.now();
      this.attempt = 0;
      if (!this.linked) { this.linked = true; this.handlers.link(true, ''); }
      if (typeof event.data === 'string') this.onText(JSON.parse(event.data));
      else this.onFrame(event.data);
    };
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      this.linked = false;
      this.handlers.link(false, event.code === 1013 ? 'all places of the server are taken' : this.token === undefined && event.code === 1006 && this.attempt > 3 ? 'nilio view does not answer; a token may be missing' : 'nilio view does not answer');
      const wait = kRetryMs[Math.min(this.attempt++, kRetryMs.length - 1)];
      setTimeout(() => { if (this.socket === socket) this.connect(); }, wait);
    };
  }

  /** A connection without a word is replaced. */
  check() {
    if (performance.now() - this.heardAt < kSilentMs) return;
    const socket = this.socket;
    this.socket = null;
    socket.onclose = socket.onmessage = null;
    socket.close();
    if (this.linked) this.handlers.link(false, 'the connection is silent');
    this.linked = false;
    this.connect();
  }

  reset() {
    this.path = new GrowingPath();
    this.tiles = new Map();
    this.rows = [];
    this.lastDrive = undefined;
    this.handlers.reset();
  }

  onText(message) {
    if (message.type === 'hello') this.handlers.hello(message);
    else if (message.type === 'state') {
      if (this.lastDrive !== undefined && message.drive !== this.lastDrive) {
        this.rows = [];
        this.handlers.drive();
      }
      this.lastDrive = message.drive;
      this.handlers.state(message);
    } else if (message.type === 'summary') this.handlers.summary(message);
    else if (message.type === 'events') this.handlers.events(message.events);
    else if (message.type === 'rows') {
      // Times begin anew with another drive.
      for (const row of message.rows) {
        if (this.rows.length && row[1] < this.rows[this.rows.length - 1][1]) this.rows = [];
        this.rows.push(row);
      }
      if (this.rows.length > kRows) this.rows.splice(0, this.rows.length - kRows);
      this.handlers.rows(this.rows);
    }
  }

  onFrame(buffer) {
    const view = new DataView(buffer);
    const header = readHeader(view, 0);
    if (!header) return;
    const bytes = buffer.byteLength - header.data;
    if (header.kind === kinds.path && bytes >= 32 * header.count) {
      this.path.add(view, header);
      this.handlers.path(this.path);
    } else if (header.kind === kinds.dropped) {
      const cloud = this.tiles.get(header.id);
      this.tiles.delete(header.id);
      if (cloud) this.handlers.dropped(cloud);
    } else if (header.kind === kinds.tile && bytes >= 8 * header.count) {
      let cloud = this.tiles.get(header.id);
      if (!cloud) this.tiles.set(header.id, (cloud = new Cloud(header)));
      cloud.add(header, buffer);
      this.handlers.tile(cloud, this.tiles, header);
    } else if (header.kind === kinds.scan && bytes >= 8 * header.count) {
      this.scan ??= new Cloud(header);
      this.scan.replace(header, buffer);
      this.handlers.scan(this.scan);
    }
  }
}
