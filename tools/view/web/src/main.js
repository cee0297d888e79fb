// Page of nilio view and nilio report: chooses the source, joins picture, cards, timeline and keys.
import { Stage } from './stage.js';
import { LiveSource } from './live.js';
import { LivePanels } from './panels_live.js';
import { RunPanels } from './panels_run.js';
import { Timeline } from './timeline.js';
import { onSeek, restyleCharts, setMark } from './charts.js';
import { indexAt, isReport, loadRuns } from './runs.js';
import { loadSettings, storeSettings } from './settings.js';
import { colourAt, css, levels, paletteNames, runColours, stateColours, states } from './palettes.js';
import { clock, element, number, text, words } from './ui.js';

const find = (id) => document.getElementById(id);
const settings = loadSettings();
const token = new URLSearchParams(location.hash.slice(1)).get('token') ?? undefined;
// The token leaves the address bar and the history.
if (token) history.replaceState(null, '', location.pathname + location.search);
const stage = new Stage({ stage: find('stage'), ground: find('ground'), points: find('points'), lines: find('lines') }, settings);
window.nilio = { stage, settings, ready: false };

const prefersDark = matchMedia('(prefers-color-scheme: dark)');
const theme = () => (settings.theme || (prefersDark.matches ? 'dark' : 'light'));

const controls = {};

function applyTheme() {
  document.documentElement.dataset.theme = theme();
  find('theme').textContent = theme() === 'dark' ? '☀' : '☾';
  stage.setTheme(theme() === 'dark');
  restyleCharts();
  app?.themed?.();
  showLegend();
}

function select(name, title, options, onchange) {
  const made = element('select', { 'aria-label': title, title, onchange: () => onchange(made.value) },
    options.map(([value, label]) => element('option', { value, selected: settings[name] === value }, label)));
  controls[name] = made;
  return element('label', {}, element('span', {}, title), made);
}

function toggle(name, label, title) {
  const made = element('button', { class: 'toggle', 'aria-pressed': String(settings[name]), title, onclick: () => {
    settings[name] = !settings[name];
    made.setAttribute('aria-pressed', String(settings[name]));
    storeSettings(settings);
    stage.redraw();
  } }, label);
  controls[name] = made;
  return made;
}

function setColour(mode) {
  settings.colour = mode;
  if (controls.colour) controls.colour.value = mode;
  storeSettings(settings);
  stage.recolour();
  showLegend();
}

function buildTools(live, truth, several) {
  const mode = (name, label, key) => element('button', { class: 'mode', 'data-mode': name, 'aria-pressed': 'false', title: `${label} (${key})`, onclick: () => setMode(name) }, label);
  const size = element('input', { type: 'range', min: 0.5, max: 4, step: 0.25, value: settings.size, 'aria-label': 'Size of the points', title: 'Size of the points (+ and -)', oninput: () => { settings.size = Number(size.value); storeSettings(settings); stage.redraw(); } });
  controls.size = size;
  const more = element('details', { class: 'more' }, element('summary', { title: 'Colours and layers' }, 'Layers'),
    element('div', { class: 'menu' },
      select('colour', 'points by', [['height', 'height'], ...(live ? [['intensity', 'intensity']] : []), ['time', live ? 'time' : 'order'], ['plain', 'plain'], ...(several ? [['run', 'run']] : [])], setColour),
      select('palette', 'palette', paletteNames.map((name) => [name, name]), (value) => { settings.palette = value; storeSettings(settings); applyTheme(); }),
      select('pathColour', 'path by', [['state', 'state'], ['speed', 'speed'], ...(truth ? [['error', 'error']] : []), ['plain', several ? 'run' : 'plain']], (value) => { settings.pathColour = value; storeSettings(settings); stage.redraw(); showLegend(); }),
      element('label', {}, element('span', {}, 'point size'), size),
      element('div', { class: 'toggles' }, toggle('grid', 'grid', 'Ground grid (G)'), toggle('shading', 'shading', 'Shading of depth edges (E)'), toggle('showVehicle', 'vehicle', 'Vehicle and its field of view (V)'),
        live ? toggle('showScan', 'scan', 'Newest scan (C)') : null, truth ? toggle('showTruth', 'truth', 'True trajectory (R)') : null)));
  find('tools').replaceChildren(
    element('div', { class: 'group', role: 'group', 'aria-label': 'Camera' }, mode('follow', 'Follow', '1'), mode('orbit', 'Orbit', '2'), mode('top', 'Top', '3')),
    element('button', { onclick: () => stage.fit(), title: 'Show the whole path (F)' }, 'Fit'),
    more,
    element('button', { onclick: savePng, title: 'Save the picture as PNG (P)' }, 'PNG'));
}

function setMode(mode) {
  stage.setMode(mode);
  showMode();
}

function showMode() {
  for (const button of document.querySelectorAll('.mode')) button.setAttribute('aria-pressed', String(button.dataset.mode === stage.camera.mode));
}

async function savePng() {
  const blob = await stage.png();
  const link = element('a', { href: URL.createObjectURL(blob), download: 'nilio.png' });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** What the colours mean. */
function showLegend() {
  const parts = [];
  const ramp = (title, palette, low, high) => {
    const bar = element('i', { class: 'ramp' });
    bar.style.background = `linear-gradient(90deg, ${Array.from({ length: 9 }, (_, i) => css(colourAt(palette, theme() === 'dark' ? 0.15 + 0.85 * (i / 8) : 0.86 * (i / 8)))).join(',')})`;
    return element('div', { class: 'legend-row' }, element('span', {}, title), element('span', { class: 'mono' }, low), bar, element('span', { class: 'mono' }, high));
  };
  const dots = (names, colours, present) => element('div', { class: 'legend-row' }, names.map((name, i) => {
    if (present && !present.has(i)) return null;
    const dot = element('i', { class: 'line' });
    dot.style.background = colours[i];
    return element('span', {}, dot, words(name));
  }));
  if (settings.colour === 'height') parts.push(ramp('height', settings.palette, `${number(stage.range.low, 1)}`, `${number(stage.range.high, 1)} m`));
  if (settings.colour === 'time') parts.push(ramp(app?.live ? 'time' : 'order', settings.palette, 'first', 'last'));
  if (settings.colour === 'intensity') parts.push(ramp('intensity', settings.palette, 'weak', 'strong'));
  if (settings.pathColour === 'speed') parts.push(ramp('speed', 'viridis', number(stage.speedRange[0], 1), `${number(stage.speedRange[1], 1)} m/s`));
  if (settings.pathColour === 'error') parts.push(ramp('error', 'cividis', '0', `${number(stage.errorRange[1], 3)} m (p95)`));
  if (settings.pathColour === 'state') {
    const present = new Set();
    for (const drive of stage.drives) for (let i = 0; i < drive.path.count; i += 1 + Math.floor(drive.path.count / 4000)) present.add(drive.path.state?.[i] ?? 1);
    if (stage.drives.some((drive) => drive.path.state)) parts.push(dots(states, stateColours[theme()], present));
  }
  if (settings.pathColour === 'plain' && stage.drives.length > 1) parts.push(dots(stage.drives.map((d) => d.name), runColours[theme()]));
  find('legend').replaceChildren(...parts);
}

function keys(list) {
  const dialog = find('keys');
  dialog.replaceChildren(element('h2', {}, 'Keys'), element('dl', { class: 'pairs' }, list.map(([key, label]) => [element('dt', {}, element('kbd', {}, key)), element('dd', {}, label)])),
    element('p', { class: 'muted' }, 'Mouse: drag turns, shift or right button moves, wheel zooms, double click shows the whole path. Touch: one finger turns, two move and zoom.'),
    element('details', {}, element('summary', {}, 'Licences of the parts of this page'), element('pre', {}, find('licences').innerHTML.replaceAll('&lt;', '<').replaceAll('&amp;', '&'))),
    element('form', { method: 'dialog' }, element('button', {}, 'Close')));
  dialog.showModal();
}

const commonKeys = [['1', 'follow the vehicle'], ['2', 'orbit'], ['3', 'from above'], ['F', 'show the whole path'], ['+ −', 'size of the points'], ['H I T', 'points by height, intensity, time'], ['G', 'grid'], ['E', 'shading'], ['V', 'vehicle'], ['P', 'save as PNG'], ['L', 'light or dark'], ['?', 'this list']];

function listen(more) {
  document.addEventListener('keydown', (event) => {
    const inField = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== 'checkbox';
    if (event.ctrlKey || event.metaKey || event.altKey || find('keys').open) return;
    if (inField && (event.key.length !== 1 || event.target.tagName === 'SELECT')) return;
    const press = (name) => controls[name]?.click();
    const actions = {
      1: () => setMode('follow'), 2: () => setMode('orbit'), 3: () => setMode('top'), f: () => stage.fit(), p: savePng,
      h: () => setColour('height'), i: () => app?.live && setColour('intensity'), t: () => setColour('time'), g: () => press('grid'), e: () => press('shading'),
      v: () => press('showVehicle'), c: () => press('showScan'), r: () => press('showTruth'), l: () => find('theme').click(), '?': () => find('help').click(),
      '+': () => resize(0.25), '=': () => resize(0.25), '-': () => resize(-0.25), ...more,
    };
    const resize = (step) => { controls.size.value = Number(controls.size.value) + step; controls.size.dispatchEvent(new Event('input')); };
    const action = actions[event.key] ?? actions[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  });
}

let app = null;

/** A live drive. */
function startLive() {
  const panels = new LivePanels(find('panels'), theme);
  const drive = { name: 'live', tiles: new Map(), path: { count: 0, xyz: new Float32Array(0) } };
  stage.drives = [drive];
  buildTools(true, false, false);
  let placed = false, recolourAt = 0, legendAt = 0;
  let lastState = null;
  const link = (up, why) => {
    const pill = find('link');
    pill.dataset.tone = up ? 'ok' : 'bad';
    text(pill, up ? 'connected' : 'reconnecting');
    if (!up) showSilence(why);
    window.nilio.linked = up;
  };
  const showSilence = (why) => {
    const box = find('silence');
    box.hidden = !why;
    text(box, why);
    find('stage').classList.toggle('silent', Boolean(why));
  };
  const source = new LiveSource({
    link,
    hello(message) {
      text(find('place'), `${message.place} · version ${message.version}`);
      panels.clearEvents();
    },
    reset() {
      for (const cloud of drive.tiles.values()) stage.backend.forget(cloud);
      if (stage.scan) stage.backend.forget(stage.scan);
      drive.tiles = new Map();
      drive.path = { count: 0, xyz: new Float32Array(0) };
      stage.scan = null;
      stage.redraw();
    },
    drive() {
      stage.pose = null;
      placed = false;
      showLegend();
    },
    state(message) {
      lastState = message;
      window.nilio.state = message;
      panels.update(message);
      showSilence(message.alive ? '' : message.why);
      const pill = find('link');
      pill.dataset.tone = message.alive ? 'ok' : 'bad';
      text(pill, message.alive ? 'live' : 'no poses');
      const pose = message.pose;
      if (pose) {
        stage.setPose({ position: pose.position, orientation: pose.orientation }, message.scan?.degenerate_axes ?? 0, placed);
        if (!placed) {
          placed = true;
          stage.setMode(settings.mode ?? 'follow');
          showMode();
        }
        stage.range.time = Math.max(pose.time_s, 1);
        find('points').setAttribute('aria-label', `Map, scan and path; ${message.scan?.state ?? ''} at x ${number(pose.position[0], 0)}, y ${number(pose.position[1], 0)} m`);
      }
      const now = performance.now();
      if (now > recolourAt) {
        recolourAt = now + 2000;
        stage.recolour();
      }
      if (now > legendAt) {
        legendAt = now + 1000;
        showLegend();
        showHud();
      }
      window.nilio.ready = true;
    },
    summary(message) { window.nilio.summary = message; panels.summary(message); },
    rows(rows) { panels.rows(rows); },
    events(events) { panels.addEvents(events); },
    path(path) {
      drive.path = path;
      let low = Infinity, high = -Infinity;
      for (let i = 0; i < path.count; ++i) { low = Math.min(low, path.speed[i]); high = Math.max(high, path.speed[i]); }
      stage.speedRange = [Math.min(low, 0), Math.max(high, 1)];
      stage.redraw();
    },
    scan(scan) {
      stage.scan = scan;
      stage.colourCloud(scan);
    },
    tile(cloud, tiles) {
      drive.tiles = tiles;
      stage.colourCloud(cloud);
    },
    dropped(cloud) { stage.backend.forget(cloud); stage.redraw(); },
  }, token);
  function showHud() {
    const total = [...drive.tiles.values()].reduce((sum, cloud) => sum + cloud.count, 0);
    text(find('hud'), total ? `${total.toLocaleString('en')} points · ${number(stage.frameRate(), 0)} frames/s` : '');
  }
  find('help').addEventListener('click', () => keys([...commonKeys, ['C', 'newest scan']]));
  listen({});
  app = { live: true, source, themed: () => panels.rows(source.rows) };
}

/** Finished runs, served or inside this file. */
async function startRuns() {
  const inside = isReport();
  const { drives, version } = await loadRuns(token);
  stage.drives = drives;
  const several = drives.length > 1;
  const hasTruth = drives.some((drive) => drive.truth || drive.run.errors);
  if (several && settings.pathColour === 'state') settings.pathColour = 'plain';
  if (!hasTruth && settings.pathColour === 'error') settings.pathColour = 'state';
  if (settings.colour === 'intensity') settings.colour = 'height';
  if (!several && settings.colour === 'run') settings.colour = 'height';
  text(find('place'), `${several ? `${drives.length} runs` : drives[0].name} · version ${version}`);
  const pill = find('link');
  pill.dataset.tone = 'ok';
  text(pill, inside ? 'report' : 'finished run');
  const worst = [];
  let fastest = 1;
  drives.forEach((drive, i) => {
    const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
    const c = rgb(runColours[theme()][i % runColours[theme()].length]);
    drive.pointColour = (0xff000000 | (c[2] << 16) | (c[1] << 8) | c[0]) >>> 0;
    if (drive.path.error) for (const error of drive.path.error) worst.push(error);
    for (const speed of drive.path.speed) fastest = Math.max(fastest, speed);
  });
  worst.sort((a, b) => a - b);
  stage.errorRange = [0, worst.length ? worst[Math.floor(0.95 * (worst.length - 1))] : 1];
  stage.speedRange = [0, fastest];
  buildTools(false, hasTruth, several);
  let selected = 0;
  const panels = new RunPanels(find('panels'), drives, theme, (i) => {
    selected = i;
    stage.selected = i;
    panels.show(i);
    timeline.setDrive(drives[i]);
  });
  const timeline = new Timeline(find('timeline'), theme, (time) => {
    const drive = drives[selected];
    const i = indexAt(drive.path.time, time + 1e-6);
    const p = drive.run.poses;
    const pose = { position: [p.x[i], p.y[i], p.z[i]], orientation: [p.qx[i], p.qy[i], p.qz[i], p.qw[i]] };
    const scans = drive.run.scans;
    const j = scans ? indexAt(scans.time_s, time + 1e-6) : -1;
    const jump = Math.abs(time - (stage.lastTime ?? time)) > 2;
    stage.lastTime = time;
    stage.setPose(pose, j >= 0 ? Number(scans.degenerate_axes[j]) : 0, !jump && timeline.playing);
    stage.until = i;
    setMark(time);
    const state = drive.path.state ? states[drive.path.state[i]] : '';
    text(find('hud'), [state, `${number(drive.path.speed[i], 1)} m/s`, drive.path.error ? `error ${number(drive.path.error[i], 3)} m` : '', drive.path.level && drive.path.level[i] ? words(levels[drive.path.level[i]]) : ''].filter(Boolean).join(' · '));
    window.nilio.time = time;
  });
  stage.bottom = 56;
  stage.selected = 0;
  panels.onTime = (time) => timeline.set(time);
  panels.onVisible = () => stage.redraw();
  onSeek((time) => timeline.set(time));
  stage.recolour();
  stage.groundHeight = drives[0].path.xyz[2];
  timeline.setDrive(drives[0]);
  stage.camera.yaw = 2.0;
  stage.camera.pitch = 0.68;
  stage.setMode('orbit');
  if (settings.mode) stage.setMode(settings.mode);
  showMode();
  showLegend();
  find('help').addEventListener('click', () => keys([...commonKeys, ['space', 'play or pause'], ['← →', 'one second back or on'], ['R', 'true trajectory']]));
  listen({ ' ': () => timeline.toggle(), ArrowLeft: () => timeline.step(-1), ArrowRight: () => timeline.step(1) });
  app = { live: false, themed: () => { timeline.drawStrip(); panels.show(selected); } };
  window.nilio.timeline = timeline;
  window.nilio.ready = true;
}

stage.onMoved = showMode;
find('theme').addEventListener('click', () => {
  settings.theme = theme() === 'dark' ? 'light' : 'dark';
  storeSettings(settings);
  applyTheme();
});
prefersDark.addEventListener('change', applyTheme);
applyTheme();

async function start() {
  if (isReport()) return startRuns();
  const response = await fetch('/mode.json', token ? { headers: { authorization: `Bearer ${token}` } } : {});
  if (response.status === 401) throw new Error('a token is needed: open the address that nilio view printed');
  const { mode } = await response.json();
  return mode === 'runs' ? startRuns() : startLive();
}

start().catch((error) => {
  const box = find('silence');
  box.hidden = false;
  text(box, String(error.message ?? error));
  find('link').dataset.tone = 'bad';
  text(find('link'), 'failed');
  console.error(error);
});
