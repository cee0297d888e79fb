// Draws points without a graphics processor: one pass over int16 points, a depth buffer, then shading of
// depth edges (eye-dome lighting). Ten times faster than WebGL on a processor (docs/view.md).

const kShades = 64;

export class RasterBackend {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.name = 'processor';
    this.table = new Uint32Array(256);
    this.shade = new Uint8Array(kShades + 1);
    for (let i = 0; i <= kShades; ++i) this.shade[i] = Math.round(255 * Math.exp((-3.2 * i) / kShades));
  }

  /** Pixels are those of the screen up to 1.4 million: more cost time and show little. */
  resize(width, height, ratio) {
    const scale = Math.min(ratio, Math.sqrt(1.4e6 / Math.max(width * height, 1)));
    this.width = Math.max(1, Math.round(width * scale));
    this.height = Math.max(1, Math.round(height * scale));
    this.scale = scale;
    this.canvas.width = this.width;
    this.canvas.height = this.height;
    this.image = this.context.createImageData(this.width, this.height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.depth = new Float32Array(this.width * this.height);
    this.depthBits = new Int32Array(this.depth.buffer);
  }

  setPalette(rgb) {
    for (let i = 0; i < 256; ++i)
      this.table[i] = 0xff000000 | (rgb[3 * i + 2] << 16) | (rgb[3 * i + 1] << 8) | rgb[3 * i];
  }

  /** `clouds`: [{cloud, count, bright, size}], farthest limits first; nothing of them is kept. */
  draw(camera, clouds, options) {
    this.pixels.fill(0);
    this.depth.fill(Infinity);
    for (const item of clouds) this.drawCloud(camera, item, options.size);
    if (options.shading) this.shadeEdges();
    this.context.putImageData(this.image, 0, 0);
  }

  drawCloud(camera, { cloud, count, colour }, size) {
    const { pixels, depth, width, height, table } = this;
    const { right: r, up: u, forward: f, eye } = camera;
    const o = cloud.origin, s = cloud.scale, focal = camera.focal * this.scale;
    const dx = o[0] - eye[0], dy = o[1] - eye[1], dz = o[2] - eye[2];
    const bx = (dx * r[0] + dy * r[1] + dz * r[2]) * focal, by = -(dx * u[0] + dy * u[1] + dz * u[2]) * focal;
    const bz = dx * f[0] + dy * f[1] + dz * f[2];
    const xx = r[0] * s * focal, xy = r[1] * s * focal, xz = r[2] * s * focal;
    const yx = -u[0] * s * focal, yy = -u[1] * s * focal, yz = -u[2] * s * focal;
    const zx = f[0] * s, zy = f[1] * s, zz = f[2] * s;
    const near = camera.near, cx = width / 2, cy = height / 2;
    const points = cloud.points, colours = cloud.colours;
    const world = size * 0.05 * focal, most = Math.max(1, Math.round(size * 2.2 * this.scale));
    const least = Math.max(1, Math.round(size * 0.8 * this.scale));
    for (let i = 0, j = 0; i < count; ++i, j += 4) {
      const x = points[j], y = points[j + 1], z = points[j + 2];
      const d = bz + zx * x + zy * y + zz * z;
      if (d < near) continue;
      const inverse = 1 / d;
      let side = (world * inverse) | 0;
      side = side < least ? least : side > most ? most : side;
      const px = (cx + (bx + xx * x + xy * y + xz * z) * inverse - side / 2) | 0;
      const py = (cy + (by + yx * x + yy * y + yz * z) * inverse - side / 2) | 0;
      if (px < 0 || py < 0 || px + side > width || py + side > height) continue;
      const pixel = colour === undefined ? table[colours[i]] : colour;
      for (let row = 0, at = py * width + px; row < side; ++row, at += width) {
        for (let k = at; k < at + side; ++k) {
          if (d < depth[k]) {
            depth[k] = d;
            pixels[k] = pixel;
          }
        }
      }
    }
  }

  /**
   * Darkens a pixel by how much nearer its neighbours are. The bits of a positive float grow nearly with its
   * logarithm, which saves one for every pixel.
   */
  shadeEdges() {
    const { pixels, depthBits: bits, width, height, shade } = this;
    const infinite = 0x7f800000;
    const reach = this.scale > 1.2 ? 2 : 1;
    const limit = 1 << 20;  // an eighth of an octave
    for (let y = reach; y < height - reach; ++y) {
      for (let x = reach, at = y * width + reach; x < width - reach; ++x, ++at) {
        const own = bits[at];
        if (own === infinite) continue;
        let sum = 0;
        let d = own - bits[at - reach];
        if (d > 0) sum += d > limit ? limit : d;
        d = own - bits[at + reach];
        if (d > 0) sum += d > limit ? limit : d;
        d = own - bits[at - reach * width];
        if (d > 0) sum += d > limit ? limit : d;
        d = own - bits[at + reach * width];
        if (d > 0) sum += d > limit ? limit : d;
        if (sum < 16384) continue;
        const k = shade[Math.min(kShades, (sum * kShades) / (3 * limit)) | 0];
        const c = pixels[at];
        pixels[at] = 0xff000000 | ((((c >> 16) & 255) * k) >> 8) << 16 | ((((c >> 8) & 255) * k) >> 8) << 8 | (((c & 255) * k) >> 8);
      }
    }
  }

  forget() {}
  dispose() {}
}
