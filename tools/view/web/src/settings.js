// What the reader chose, kept by the browser where it lets us.
const key = 'nilio-view';
const defaults = { theme: '', palette: 'viridis', colour: 'height', pathColour: 'state', size: 1, shading: true, grid: true, showScan: true, showTruth: true, showVehicle: true };

export function loadSettings() {
  let stored = {};
  try { stored = JSON.parse(localStorage.getItem(key) ?? '{}') ?? {}; } catch { /* not kept */ }
  const settings = { ...defaults };
  for (const name of Object.keys(defaults)) if (typeof stored[name] === typeof defaults[name]) settings[name] = stored[name];
  const query = new URLSearchParams(location.search);
  for (const name of ['theme', 'palette', 'colour', 'pathColour', 'renderer', 'mode']) if (query.has(name)) settings[name] = query.get(name);
  return settings;
}

export function storeSettings(settings) {
  const kept = Object.fromEntries(Object.keys(defaults).map((name) => [name, settings[name]]));
  try { localStorage.setItem(key, JSON.stringify(kept)); } catch { /* not kept */ }
}
