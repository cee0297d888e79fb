// Clouds of packed points: int16 x, y, z in steps of `scale` from `origin`, and a value.
const kMagic = 0x314c494e;
export const kinds = { scan: 1, tile: 2, path: 3, dropped: 4 };
export const values = { none: 0, intensity: 1, order: 2 };

/** Header at `at` of a binary message, and where its data begin. */
export function readHeader(view, at) {
  if (view.byteLength - at < 48 || view.getUint32(at, true) !== kMagic) return null;
  return {
    kind: view.getUint16(at + 4, true), value: view.getUint16(at + 6, true),
    id: view.getUint32(at + 8, true), count: view.getUint32(at + 12, true),
    origin: [16, 24, 32].map((o) => view.getFloat64(at + o, true)),
    scale: view.getFloat32(at + 40, true), time: view.getFloat32(at + 44, true), data: at + 48,
  };
}

/** Points of a tile or scan, with a colour index for each. */
export class Cloud {
  constructor(header) {
    this.origin = header.origin;
    this.scale = header.scale;
    this.value = header.value;
    this.count = 0;
    this.points = new Int16Array(0);
    this.times = new Float32Array(0);
    this.colours = new Uint8Array(0);
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
    this.version = 0;
  }

  reserve(count) {
    if (count * 4 <= this.points.length) return;
    const room = Math.max(count, Math.ceil(this.points.length * 0.375), 256);
    const grow = (Type, old, stride) => {
      const array = new Type(room * stride);
      array.set(old.subarray(0, this.count * stride));
      return array;
    };
    this.points = grow(Int16Array, this.points, 4);
    this.times = grow(Float32Array, this.times, 1);
    this.colours = grow(Uint8Array, this.colours, 1);
  }

  /** Replaces all points. */
  replace(header, buffer) {
    this.origin = header.origin;
    this.scale = header.scale;
    this.value = header.value;
    this.count = 0;
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
    this.reserve(header.count);
    this.points.set(new Int16Array(buffer, header.data, header.count * 4));
    this.times.fill(header.time, 0, header.count);
    this.count = header.count;
    this.measure();
    ++this.version;
  }

  /**
   * Adds points in places drawn at random, so that any first part of the points is an even sample: level of
   * detail without further data.
   */
  add(header, buffer) {
    const added = new Int16Array(buffer, header.data, header.count * 4);
    this.reserve(this.count + header.count);
    for (let i = 0; i < header.count; ++i) {
      const end = this.count;
      const j = Math.floor(Math.random() * (end + 1));
      if (j !== end) {
        this.points.copyWithin(end * 4, j * 4, j * 4 + 4);
        this.times[end] = this.times[j];
        this.colours[end] = this.colours[j];
      }
      for (let k = 0; k < 4; ++k) this.points[j * 4 + k] = added[i * 4 + k];
      this.times[j] = header.time;
      this.count = end + 1;
    }
    this.measure();
    ++this.version;
  }

  measure() {
    for (let i = 0; i < this.count; ++i) {
      for (let k = 0; k < 3; ++k) {
        const v = this.points[i * 4 + k] * this.scale + this.origin[k];
        if (v < this.low[k]) this.low[k] = v;
        if (v > this.high[k]) this.high[k] = v;
      }
    }
  }

  /** Colour indices by `mode`: height, intensity, time, plain; `range` of heights and times. */
  colour(mode, range) {
    const { points, colours, count } = this;
    if (mode === 'height') {
      const k = (255 * this.scale) / Math.max(range.high - range.low, 1e-3);
      const c = (255 * (this.origin[2] - range.low)) / Math.max(range.high - range.low, 1e-3);
      for (let i = 0; i < count; ++i) colours[i] = Math.min(255, Math.max(0, points[i * 4 + 2] * k + c));
    } else if (mode === 'intensity' && this.value === values.intensity) {
      for (let i = 0; i < count; ++i) colours[i] = Math.min(255, 16 * Math.sqrt((points[i * 4 + 3] & 0xffff) * range.gain));
    } else if (mode === 'time') {
      if (this.value === values.order) {
        for (let i = 0; i < count; ++i) colours[i] = (points[i * 4 + 3] & 0xffff) >> 8;
      } else {
        const k = 255 / Math.max(range.time, 1e-3);
        for (let i = 0; i < count; ++i) colours[i] = Math.min(255, this.times[i] * k);
      }
    } else {
      colours.fill(120, 0, count);
    }
    ++this.version;
  }
}

/** Heights that hide the outer 1 % of the points, of a sample of the clouds. */
export function heightRange(clouds) {
  const heights = [];
  let total = 0;
  for (const cloud of clouds) total += cloud.count;
  const share = Math.min(1, 20000 / Math.max(total, 1));
  for (const cloud of clouds) {
    const n = Math.ceil(cloud.count * share);
    for (let i = 0; i < n; ++i) heights.push(cloud.points[i * 4 + 2] * cloud.scale + cloud.origin[2]);
  }
  if (heights.length === 0) return [0, 1];
  heights.sort((a, b) => a - b);
  const at = (q) => heights[Math.min(heights.length - 1, Math.floor(q * heights.length))];
  return [at(0.01), Math.max(at(0.99), at(0.01) + 0.5)];
}
