// Colours that people with colour vision deficiency can tell apart: 17 stops of each map, linear between.
const stops = {
  viridis: '440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725',
  cividis: '002051 012b65 11366c 26426e 3c4d6e 51586e 62646f 727071 7f7c75 8c8877 9a9478 a9a177 bbaf71 cebd68 e2cb5c f3da4f fdea45',
  turbo: '23171b 493eae 4569ee 3295f7 26bce1 29dcbc 3ff393 65fd6e 95fb51 c5ec3c ecd12e ffad24 ff821d f05616 cb2f0d a31302 900c00',
  grey: '3a444d 424d57 4b5660 545f6a 5d6974 66727d 6f7b87 788591 818e9a 8a98a4 93a1ad 9cabb7 a5b4c0 aebec9 b7c7d2 c0d1dc c9dae5',
};

export const paletteNames = ['viridis', 'cividis', 'turbo', 'grey'];

const parsed = Object.fromEntries(Object.entries(stops).map(([name, text]) =>
  [name, text.split(' ').map((hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16)))]));

/** Red, green, blue (0..255) at `share` 0..1. */
export function colourAt(name, share) {
  const list = parsed[name];
  const at = Math.min(Math.max(share, 0), 1) * (list.length - 1);
  const i = Math.min(Math.floor(at), list.length - 2);
  return [0, 1, 2].map((k) => Math.round(list[i][k] + (at - i) * (list[i + 1][k] - list[i][k])));
}

export const css = (rgb, alpha = 1) => `rgba(${rgb[0]},${rgb[1]},${rgb[2]},${alpha})`;

/** 256 entries; the ends that vanish on the ground of the theme are left out. */
export function pointTable(name, dark) {
  const table = new Uint8Array(256 * 3);
  for (let i = 0; i < 256; ++i) {
    const share = i / 255;
    const rgb = name === 'grey'
      ? (dark ? colourAt(name, share) : colourAt(name, 0.75 - 0.75 * share))
      : colourAt(name, dark ? 0.18 + 0.82 * share : 0.86 * share);
    table.set(rgb, 3 * i);
  }
  return table;
}

export const states = ['initialising', 'tracking', 'degraded', 'lost', 'before this view'];
export const levels = ['full', 'fewer_points', 'icp_only', 'ndt_only', 'prediction'];

/** Okabe and Ito; never the only mark of a state. */
export const stateColours = {
  dark: ['#9aa7b2', '#56B4E9', '#E69F00', '#ff6a2b', '#7d8fa0'],
  light: ['#6b7884', '#0072B2', '#c27f00', '#D55E00', '#8796a3'],
};
export const levelColours = {
  dark: ['#2f7fb8', '#56B4E9', '#F0E442', '#E69F00', '#ff6a2b'],
  light: ['#0072B2', '#56B4E9', '#d8b400', '#E69F00', '#D55E00'],
};
export const runColours = {
  dark: ['#56B4E9', '#E69F00', '#19c496', '#CC79A7', '#F0E442', '#ff6a2b', '#9aa7b2', '#ffffff'],
  light: ['#0072B2', '#D55E00', '#009E73', '#a8508a', '#000000', '#b58900', '#6b7884', '#444444'],
};
