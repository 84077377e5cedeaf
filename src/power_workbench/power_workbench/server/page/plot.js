// Plots in the page's colours; nothing but Plotly draws.

import { fill, h } from './dom.js';

const colors = new Map();

/** A colour of the theme; asked of the style once, which takes long after each change of the page. */
export function color(name) {
  if (!colors.has(name)) colors.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return colors.get(name);
}

const HAS_NO_COLOR = 'unexplained';

/** Colour of a family of a budget's parts. */
export const ofFamily = (one) => (one.name === HAS_NO_COLOR ? color('faint') : one.color);

/** Legend of families beside the meter's mark; its colours follow the theme. */
export function keys(node, families) {
  fill(node, families.map((one) => { const key = h('i'); key.style.background = one.name === HAS_NO_COLOR ? 'repeating-linear-gradient(45deg, var(--faint) 0 2px, transparent 2px 4px)' : one.color; return h('li', {}, key, one.words); }), h('li', {}, h('b', {}), 'metered'));
}

const drawn = new Map();

function layout(more) {
  const axis = {
    gridcolor: color('grid'), zerolinecolor: color('line'), linecolor: color('line'),
    tickfont: { size: 12 }, title: { font: { size: 13 }, standoff: 6 },
  };
  const out = {
    paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', showlegend: false,
    font: { color: color('text'), family: 'system-ui, "DejaVu Sans", sans-serif', size: 13 },
    margin: { l: 58, r: 12, t: 10, b: 42 }, hovermode: 'closest', uirevision: 'same',
    legend: { orientation: 'h', x: 0, y: 1.02, yanchor: 'bottom' }, hoverlabel: { font: { size: 12 } },
    newselection: { line: { color: color('lit'), width: 2 } }, activeselection: { fillcolor: color('lit'), opacity: 0.12 },
    ...more,
  };
  for (const name of Object.keys(out)) if (/^[xy]axis/.test(name)) out[name] = { ...axis, ...out[name], title: { ...axis.title, ...(out[name].title || {}) } };
  return out;
}

/** Draw a figure; make() returns [data, layout] and is called again when colours change. */
export async function draw(node, words, make) {
  node.setAttribute('role', 'img');
  node.setAttribute('aria-label', words);
  drawn.set(node, make);
  const [data, given] = make();
  await window.Plotly.react(node, data, layout(given), {
    responsive: true, displayModeBar: false, doubleClick: false, showTips: false,
  });
  // Drawn anew, a plot keeps its size: more rows need a taller box.
  if (node.isConnected && node.clientHeight && Math.abs(node.clientHeight - node._fullLayout?.height) > 1) await window.Plotly.Plots.resize(node);
}

export const on = (node, event, work) => {
  if (!node.listened) node.listened = new Set();
  if (node.listened.has(event)) return;
  node.listened.add(event);
  node.on(event, work);
};

/** Save a picture of a plot as it was drawn last; more: of its layout, for the picture alone. */
async function save(node, format, name, more = {}) {
  const [data, given] = drawn.get(node)();
  await window.Plotly.downloadImage({ data, layout: layout({ ...given, ...more }) }, { format, filename: name, width: 1200, height: 600 });
}

/** Buttons that save a plot; more() gives what the picture alone has in its layout. */
export const pictures = (node, name, words, more = () => ({})) => ['svg', 'png'].map((format) => h('button', { type: 'button', onclick: () => save(node, format, name, more()) }, `${words ? `${words} ` : ''}${format.toUpperCase()}`));

export const diverging = () => {
  const dark = window.matchMedia('(prefers-color-scheme: dark)').matches;
  const middle = dark ? '#3a3f45' : '#f2f2f2';
  return [[0, '#2166ac'], [0.25, '#67a9cf'], [0.5, middle], [0.75, '#ef8a62'], [1, '#b2182b']];
};

window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
  colors.clear();
  for (const [node, make] of drawn) {
    if (!node.isConnected) { drawn.delete(node); continue; }
    const [data, given] = make();
    window.Plotly.react(node, data, layout(given));
  }
});
