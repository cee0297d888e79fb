// Camera around a target: yaw and pitch in radians, z up.
const kFov = (50 * Math.PI) / 180;

export class Camera {
  constructor() {
    this.mode = 'follow';
    this.target = [0, 0, 0];
    this.distance = 45;
    this.yaw = 0;
    this.pitch = 0.42;
    this.yawOffset = 0;
    this.width = 1;
    this.height = 1;
    this.update();
  }

  /** Rows right, up, forward; the eye; focal length in pixels. */
  update() {
    const cp = Math.cos(this.pitch), sp = Math.sin(this.pitch);
    const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw);
    this.forward = [cy * cp, sy * cp, -sp];
    this.right = [sy, -cy, 0];
    this.up = [cy * sp, sy * sp, cp];
    this.eye = [0, 1, 2].map((i) => this.target[i] - this.distance * this.forward[i]);
    this.focal = (0.5 * this.height) / Math.tan(kFov / 2);
    this.near = Math.max(0.2, this.distance * 0.01);
    this.fov = kFov;
  }

  resize(width, height) {
    this.width = width;
    this.height = height;
    this.update();
  }

  /** [x, y, depth] in pixels and metres; depth may be negative. */
  project(p) {
    const x = p[0] - this.eye[0], y = p[1] - this.eye[1], z = p[2] - this.eye[2];
    const r = this.right, u = this.up, f = this.forward;
    const depth = x * f[0] + y * f[1] + z * f[2];
    const k = this.focal / Math.max(depth, 1e-6);
    return [this.width / 2 + (x * r[0] + y * r[1]) * k, this.height / 2 - (x * u[0] + y * u[1] + z * u[2]) * k, depth];
  }

  rotate(dx, dy) {
    if (this.mode === 'top') this.setMode('orbit');
    this.yaw -= dx * 0.006;
    if (this.mode === 'follow') this.yawOffset -= dx * 0.006;
    this.pitch = Math.min(Math.max(this.pitch + dy * 0.006, -0.2), 1.5608);
  }

  pan(dx, dy) {
    if (this.mode === 'follow') this.setMode('orbit');
    const k = this.distance / this.focal;
    const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw);
    const lift = Math.max(Math.sin(this.pitch), 0.25);
    this.target[0] += -dx * k * sy + (dy * k * cy) / lift;
    this.target[1] += dx * k * cy + (dy * k * sy) / lift;
    this.panned = true;
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 2), 5000);
  }

  setMode(mode) {
    this.mode = mode;
    this.panned = false;
    if (mode === 'top') {
      this.pitch = 1.5608;
      this.yaw = Math.PI / 2;
    } else if (mode === 'follow') {
      this.yawOffset = 0;
      this.pitch = 0.42;
      this.distance = Math.min(this.distance, 60);
    } else if (this.pitch > 1.4) {
      this.pitch = 0.7;
    }
  }

  /** Follows the vehicle; `blend` 0..1 is how far to go at once. */
  follow(position, yaw, blend) {
    if (this.mode === 'orbit' || this.panned) return;
    for (let i = 0; i < 3; ++i) this.target[i] += blend * (position[i] - this.target[i]);
    if (this.mode !== 'follow') return;
    const turn = yaw + this.yawOffset - this.yaw;
    this.yaw += Math.min(1, blend * 0.6) * Math.atan2(Math.sin(turn), Math.cos(turn));
  }
}
