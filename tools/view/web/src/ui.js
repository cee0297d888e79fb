// Elements and numbers. Text only ever becomes text, never markup.
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith('on')) made.addEventListener(key.slice(2), value);
    else if (key === 'class') made.className = value;
    else made.setAttribute(key, value === true ? '' : value);
  }
  made.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return made;
}

/** A card with a title; `aside` stands right of it. */
export function card(title, ...content) {
  const aside = element('span', { class: 'aside' });
  const body = element('div', { class: 'body' }, ...content);
  const made = element('section', { class: 'card', 'aria-label': title },
    element('h2', {}, element('span', {}, title), aside), body);
  return { made, body, aside };
}

/** A number with its name; `set(text, tone)` changes it. */
export function figure(name, title) {
  const value = element('b', {}, '–');
  const made = element('div', { class: 'figure', title }, value, element('span', {}, name));
  return {
    made, value,
    set(text, tone = '') {
      if (value.textContent !== text) value.textContent = text;
      made.dataset.tone = tone;
    },
  };
}

export const text = (node, content) => { if (node.textContent !== content) node.textContent = content; };

export function number(value, digits = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  return value.toFixed(digits);
}

/** Milliseconds or microseconds with three figures. */
export function duration(ms) {
  if (ms === null || ms === undefined || !Number.isFinite(ms)) return '–';
  if (ms < 0.9995) return `${(ms * 1000).toFixed(ms < 0.00995 ? 1 : 0)} µs`;
  if (ms < 1000) return `${ms.toFixed(ms < 10 ? 2 : ms < 100 ? 1 : 0)} ms`;
  return `${(ms / 1000).toFixed(2)} s`;
}

export const count = (value) => (value === null || value === undefined ? '–' : value.toLocaleString('en').replaceAll(',', '\u202f'));

export function clock(seconds) {
  const s = Math.max(0, seconds);
  const minutes = Math.floor(s / 60);
  return `${minutes}:${(s - 60 * minutes).toFixed(1).padStart(4, '0')}`;
}

export const words = (name) => name.replaceAll('_', ' ');

/** Two columns: names and values. */
export function pairs(rows) {
  return element('dl', { class: 'pairs' }, rows.map(([name, value]) => [element('dt', {}, name), element('dd', {}, value)]));
}

export function table(head, rows, options = {}) {
  return element('div', { class: 'scroll' }, element('table', options.class ? { class: options.class } : {},
    element('thead', {}, element('tr', {}, head.map((cell) => element('th', { scope: 'col' }, cell)))),
    element('tbody', {}, rows.map((row) => element('tr', {}, row.map((cell, i) =>
      element(i === 0 ? 'th' : 'td', i === 0 ? { scope: 'row' } : {}, ...[cell].flat())))))));
}
