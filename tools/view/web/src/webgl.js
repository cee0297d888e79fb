// Draws points with WebGL through three.js: int16 points as they are, colours from a table, and shading of
// depth edges in a second pass (eye-dome lighting).
import {
  BufferAttribute, BufferGeometry, DataTexture, DepthTexture, GLSL3, InterleavedBuffer, InterleavedBufferAttribute,
  LinearFilter, Mesh, NearestFilter, PerspectiveCamera, PlaneGeometry, Points, RGBAFormat, Scene, ShaderMaterial,
  Sphere, UnsignedByteType, Vector3, WebGLRenderer, WebGLRenderTarget, FloatType,
} from 'three';

const pointVertex = `
in vec3 place; in float shadeIndex;
uniform float scale; uniform float world; uniform float least; uniform float most;
out float index;
void main() {
  vec4 seen = modelViewMatrix * vec4(place * scale, 1.0);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = clamp(world / -seen.z, least, most);
  index = shadeIndex;
}`;
const pointFragment = `
in float index; uniform sampler2D palette; uniform vec4 fixedColour; out vec4 colour;
void main() {
  vec2 c = gl_PointCoord - 0.5;
  if (dot(c, c) > 0.25) discard;
  colour = mix(texture(palette, vec2((index * 255.0 + 0.5) / 256.0, 0.5)), vec4(fixedColour.rgb, 1.0), fixedColour.a);
}`;
const edgeVertex = 'out vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }';
const edgeFragment = `
in vec2 at; uniform sampler2D colours; uniform sampler2D depths; uniform vec2 pixel; uniform float near; uniform float far;
uniform float strength; out vec4 colour;
float logDepth(vec2 p) {
  float d = texture(depths, p).r;
  return d >= 1.0 ? 100.0 : log2(2.0 * near * far / (far + near - (2.0 * d - 1.0) * (far - near)));
}
void main() {
  vec4 c = texture(colours, at);
  if (c.a == 0.0) { colour = vec4(0.0); return; }
  float own = logDepth(at), sum = 0.0;
  sum += clamp(own - logDepth(at + vec2(pixel.x, 0.0)), 0.0, 0.125);
  sum += clamp(own - logDepth(at - vec2(pixel.x, 0.0)), 0.0, 0.125);
  sum += clamp(own - logDepth(at + vec2(0.0, pixel.y)), 0.0, 0.125);
  sum += clamp(own - logDepth(at - vec2(0.0, pixel.y)), 0.0, 0.125);
  colour = vec4(c.rgb * exp(-8.5 * strength * sum), 1.0);
}`;

/** The name of the renderer, or null without WebGL 2. */
export function webglRenderer() {
  const context = document.createElement('canvas').getContext('webgl2');
  if (!context) return null;
  const info = context.getExtension('WEBGL_debug_renderer_info');
  const name = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : 'unknown';
  context.getExtension('WEBGL_lose_context')?.loseContext();
  return name;
}

export const isSoftware = (name) => /SwiftShader|llvmpipe|Basic Render|softpipe/i.test(name);

export class WebglBackend {
  constructor(canvas) {
    this.canvas = canvas;
    this.name = 'WebGL';
    this.renderer = new WebGLRenderer({ canvas, alpha: true, antialias: false, preserveDrawingBuffer: false, powerPreference: 'high-performance' });
    this.renderer.setClearColor(0, 0);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(50, 1, 0.5, 5000);
    this.camera.matrixAutoUpdate = false;
    this.objects = new Map();
    this.palette = new DataTexture(new Uint8Array(256 * 4), 256, 1, RGBAFormat, UnsignedByteType);
    this.palette.magFilter = this.palette.minFilter = NearestFilter;
    this.edges = new ShaderMaterial({
      glslVersion: GLSL3, vertexShader: edgeVertex, fragmentShader: edgeFragment, depthTest: false, depthWrite: false,
      uniforms: { colours: { value: null }, depths: { value: null }, pixel: { value: [0, 0] }, near: { value: 1 }, far: { value: 1 }, strength: { value: 1 } },
    });
    this.screen = new Scene();
    const plane = new Mesh(new PlaneGeometry(2, 2), this.edges);
    plane.frustumCulled = false;
    this.screen.add(plane);
  }

  resize(width, height, ratio) {
    this.scale = ratio;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.target?.dispose();
    const w = Math.round(width * ratio), h = Math.round(height * ratio);
    const depthTexture = new DepthTexture(w, h, FloatType);
    this.target = new WebGLRenderTarget(w, h, { depthTexture, minFilter: NearestFilter, magFilter: NearestFilter });
    this.edges.uniforms.colours.value = this.target.texture;
    this.edges.uniforms.depths.value = depthTexture;
    this.edges.uniforms.pixel.value = [1.2 * ratio / w, 1.2 * ratio / h];
  }

  setPalette(rgb) {
    for (let i = 0; i < 256; ++i) this.palette.image.data.set([rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2], 255], 4 * i);
    this.palette.needsUpdate = true;
  }

  object(cloud) {
    let entry = this.objects.get(cloud);
    // Arrays on the graphics processor cannot grow.
    if (entry && entry.room !== cloud.points.length) {
      this.forget(cloud);
      entry = undefined;
    }
    if (!entry) {
      const geometry = new BufferGeometry();
      const buffer = new InterleavedBuffer(cloud.points, 4);
      geometry.setAttribute('place', new InterleavedBufferAttribute(buffer, 3, 0, false));
      const colours = new BufferAttribute(cloud.colours, 1, true);
      geometry.setAttribute('shadeIndex', colours);
      geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
      const material = new ShaderMaterial({
        glslVersion: GLSL3, vertexShader: pointVertex, fragmentShader: pointFragment,
        uniforms: { scale: { value: cloud.scale }, palette: { value: this.palette }, world: { value: 1 }, least: { value: 1 }, most: { value: 1 }, fixedColour: { value: [0, 0, 0, 0] } },
      });
      const points = new Points(geometry, material);
      points.frustumCulled = false;
      points.matrixAutoUpdate = false;
      entry = { points, buffer, colours, material, geometry, room: cloud.points.length, version: -1 };
      this.objects.set(cloud, entry);
      this.scene.add(points);
    }
    if (entry.version !== cloud.version) {
      entry.buffer.needsUpdate = true;
      entry.colours.needsUpdate = true;
      entry.version = cloud.version;
    }
    return entry;
  }

  draw(camera, clouds, options) {
    for (const entry of this.objects.values()) entry.points.visible = false;
    const far = Math.max(2000, camera.distance * 6);
    for (const { cloud, count, colour } of clouds) {
      const entry = this.object(cloud);
      entry.points.visible = true;
      entry.geometry.setDrawRange(0, count);
      // Relative to the eye: float32 keeps its precision far from the origin.
      entry.points.matrix.makeTranslation(...[0, 1, 2].map((i) => cloud.origin[i] - camera.eye[i]));
      entry.points.matrixWorldNeedsUpdate = true;
      const u = entry.material.uniforms;
      u.scale.value = cloud.scale;
      u.world.value = options.size * 0.05 * camera.focal * this.scale;
      u.least.value = Math.max(1, options.size * 0.9 * this.scale);
      u.most.value = Math.max(2, options.size * 3 * this.scale);
      u.fixedColour.value = colour === undefined ? [0, 0, 0, 0] : [(colour & 255) / 255, ((colour >> 8) & 255) / 255, ((colour >> 16) & 255) / 255, 1];
    }
    const c = this.camera;
    c.fov = (camera.fov * 180) / Math.PI;
    c.aspect = camera.width / camera.height;
    c.near = camera.near;
    c.far = far;
    c.updateProjectionMatrix();
    const { right: r, up: u, forward: f } = camera;
    c.matrix.set(r[0], u[0], -f[0], 0, r[1], u[1], -f[1], 0, r[2], u[2], -f[2], 0, 0, 0, 0, 1);
    c.matrixWorldNeedsUpdate = true;
    this.renderer.setRenderTarget(this.target);
    this.renderer.clear();
    this.renderer.render(this.scene, c);
    this.renderer.setRenderTarget(null);
    this.edges.uniforms.near.value = c.near;
    this.edges.uniforms.far.value = far;
    this.edges.uniforms.strength.value = options.shading ? 1 : 0;
    this.renderer.render(this.screen, c);
  }

  forget(cloud) {
    const entry = this.objects.get(cloud);
    if (!entry) return;
    this.scene.remove(entry.points);
    entry.geometry.dispose();
    entry.material.dispose();
    this.objects.delete(cloud);
  }

  dispose() {
    for (const cloud of [...this.objects.keys()]) this.forget(cloud);
    this.target?.dispose();
    this.renderer.dispose();
  }
}
