// Where the model fails: regimes in words, a map of the error over two quantities, marks both ways.

import { attempt, bench, choices, fill, find, get, h, number, postArrays } from './dom.js';
import { color, diverging, draw, on, pictures } from './plot.js';
import { drawPoints, withPoints } from './points.js';
import { place, render as renderTraces } from './traces.js';

const PRESETS = [
  ['velocity', 'torque', 'torque and speed'], ['position', 'velocity', 'position'],
  ['acceleration', 'velocity', 'acceleration'], ['time', 'torque', 'time'],
  ['temperature', 'torque', 'temperature'], ['stride_phase', 'torque', 'phase of the stride'],
];
/** Quantities of a cell that the map shows. */
const SHOWS = { mean: ['Mean error', 'W'], rms: ['Error, rms', 'W'], seconds: ['Time', 's'] };
let shows = 'mean';
let parts = null;
let map = null;
let asked = 0;

const own = () => (bench.state.view.drives.includes(bench.drive) ? bench.drive : bench.state.view.drives[0]);
const words = (name) => name.replaceAll('_', ' ');
const titled = (name, unit) => (unit ? `${words(name)} in ${unit}` : words(name));

function build() {
  const plot = h('div', { class: 'plot map', id: 'plot-map' });
  const curve = h('div', { class: 'plot low', id: 'plot-curve' });
  const regimes = h('ul', { class: 'plain', id: 'regimes' });
  const told = h('p', { class: 'selection', id: 'selection', role: 'status', hidden: true });
  const clear = h('button', { type: 'button', hidden: true, onclick: () => mark(null, true) }, 'Clear the mark');
  const about = h('p', { class: 'faint' });
  const axes = h('div', { class: 'row' });
  const box = h('div', { class: 'row' });
  parts = { plot, curve, about, regimes, told, clear, axes, box };
  fill(find('where-body'),
    h('p', { class: 'faint' }, 'Press a sentence or drag a box: the moments light up in the traces.'), regimes,
    told, clear, axes,
    h('div', { class: 'pair' }, plot, h('div', {}, about, curve)),
    h('details', {}, h('summary', {}, 'Exact box, pictures'), box));
}

export function update() {
  if (!parts) build();
  const { view } = bench.state;
  const names = view.quantities.map((one) => one.name);
  if (!names.includes(bench.x)) bench.x = names[0];
  if (!names.includes(bench.y)) bench.y = names[1] || names[0];
  const regimes = (view.scores && view.scores.regimes) || [];
  fill(parts.regimes, regimes.map((regime, index) => h('li', {},
    h('button', { type: 'button', class: 'link', onclick: () => pick(regime, index) }, `${regime.text} (${number(regime.seconds)} s)`))));
  if (!regimes.length) fill(parts.regimes, h('li', {}, 'No state stands out: what is left looks the same everywhere.'));
  axes(names);
  load();
}

function axes(names) {
  const select = (label, value, chosen) => h('label', {}, `${label} `, h('select', { onchange: (event) => chosen(event.target.value) },
    names.map((name) => h('option', { value: name, selected: name === value }, words(name)))));
  const known = PRESETS.filter(([x, y]) => x === 'stride_phase' || (names.includes(x) && names.includes(y)));
  const now = known.find(([x, y]) => x === bench.x && y === bench.y);
  fill(parts.axes,
    choices('Over', 'map', known.map(([x, y, label]) => ({ value: `${x} ${y}`, label, disabled: !names.includes(x) })), now ? `${now[0]} ${now[1]}` : '', (value) => setAxes(...value.split(' '))),
    h('p', { class: 'faint', id: 'stride' }, bench.state.view.stride),
    select('x axis', bench.x, (value) => setAxes(value, bench.y)), select('y axis', bench.y, (value) => setAxes(bench.x, value)),
    choices('Show', 'shows', Object.entries(SHOWS).map(([value, [label]]) => ({ value, label })), shows, (value) => { shows = value; render(); }));
  const fields = ['x0', 'x1', 'y0', 'y1'].map((key) => h('input', { type: 'number', step: 'any', 'aria-label': { x0: 'x from', x1: 'x to', y0: 'y from', y1: 'y to' }[key] }));
  const go = () => markBox([Number(fields[0].value), Number(fields[1].value)], [Number(fields[2].value), Number(fields[3].value)]);
  fill(parts.box, words(bench.x), fields[0], '–', fields[1], words(bench.y), fields[2], '–', fields[3],
    h('button', { type: 'button', onclick: go }, 'Mark'), pictures(parts.plot, 'map', '', () => withPoints(parts.plot, ...chosen())));
}

function setAxes(x, y) {
  [bench.x, bench.y] = [x, y];
  axes(bench.state.view.quantities.map((one) => one.name));
  load();
  if (bench.choice) mark(bench.choice, true);
}

async function load() {
  const turn = ++asked;
  const found = await attempt(() => get('map', { drive: own(), x: bench.x, y: bench.y }));
  if (!found || turn !== asked) return;
  map = found;
  render();
}

/** States that are marked and belong on this map. */
function chosen() {
  const { selection } = bench;
  return selection && selection.drive === own() ? [selection.points_x, selection.points_y] : [[], []];
}

const renderMarks = () => drawPoints(parts.plot, ...chosen());

/** From the edge of the first cell to that of the last; marks do not move it. */
function edges(middles) {
  if (middles.length < 2) return [0, 1];
  const half = 0.5 * (middles[1] - middles[0]);
  return [middles[0] - half, middles[middles.length - 1] + half];
}

function render() {
  const [words_, unit] = SHOWS[shows];
  const z = map[shows];
  const top = map.limits[shows] || Math.max(...map.seconds.flat());
  draw(parts.plot, `${words_} of ${own()} over ${words(bench.x)} and ${words(bench.y)}.`, () => [[
    {
      type: 'heatmap', x: map.x, y: map.y, z: shows === 'seconds' ? z.map((row) => row.map((value) => value || null)) : z, zmin: shows === 'mean' ? -top : 0, zmax: top,
      colorscale: shows === 'mean' ? diverging() : [[0, color('grid')], [1, color(shows === 'rms' ? 'base' : 'better')]],
      customdata: map.seconds, colorbar: { title: { text: unit }, thickness: 12, len: 0.95 }, hovertemplate: `%{x:.3~g}, %{y:.3~g}: %{z:.3~g} ${unit}, %{customdata:.3~g} s<extra></extra>`,
    },
    // Plotly takes a box only where a trace has markers.
    { type: 'scatter', mode: 'markers', x: [map.x[0]], y: [map.y[0]], hoverinfo: 'skip', marker: { size: 1, opacity: 0 }, selected: { marker: { opacity: 0 } }, unselected: { marker: { opacity: 0 } } },
  ], {
    dragmode: 'select', selections: [], uirevision: `${bench.x} ${bench.y}`,
    xaxis: { title: { text: titled(bench.x, map.x_unit) }, range: edges(map.x), fixedrange: true },
    yaxis: { title: { text: titled(bench.y, map.y_unit) }, range: edges(map.y), fixedrange: true },
  }]);
  on(parts.plot, 'plotly_afterplot', renderMarks);
  on(parts.plot, 'plotly_selected', (event) => {
    if (event && event.range && event.range.y) markBox(event.range.x, event.range.y);
  });
  parts.about.textContent = `Error of ${own()} over ${words(bench.x)}: mean (line), and where two of three moments lie (band).`;
  const [x, mean, rms, seconds] = [0, 1, 2, 3].map((column) => map.curve.map((point) => point[column]));
  const spread = mean.map((value, index) => Math.sqrt(Math.max(rms[index] ** 2 - value ** 2, 0)));
  const band = (sign) => mean.map((value, index) => value + sign * spread[index]);
  draw(parts.curve, parts.about.textContent, () => [[
    { type: 'scatter', mode: 'lines', x: [...x, ...[...x].reverse()], y: [...band(1), ...band(-1).reverse()], fill: 'toself', fillcolor: color('line'), line: { width: 0 }, opacity: 0.5, hoverinfo: 'skip' },
    { type: 'scatter', mode: 'lines+markers', x, y: mean, customdata: seconds, line: { color: color('base'), width: 2 }, marker: { size: 5 }, hovertemplate: '%{x:.3~g}: %{y:.3~g} W, %{customdata:.3~g} s<extra></extra>' },
  ], {
    xaxis: { title: { text: titled(bench.x, map.x_unit) }, fixedrange: true },
    yaxis: { title: { text: 'error in W' }, fixedrange: true, zeroline: true },
  }]);
}

const markBox = (x, y) => mark({ drive: own(), box: { [bench.x]: [x[0], x[1]], [bench.y]: [y[0], y[1]] } });

function pick(regime, index) {
  const key = Object.keys(regime.bounds)[0];
  const x = { speed: 'velocity', torque: 'velocity' }[key] || key;
  const wanted = PRESETS.find(([across]) => across === x);
  if (wanted) [bench.x, bench.y] = wanted;
  axes(bench.state.view.quantities.map((one) => one.name));
  if (bench.drive !== 'sum' && bench.state.view.drives.includes(regime.drive)) bench.drive = regime.drive;
  const radio = document.querySelector(`input[name="drive"][value="${CSS.escape(bench.drive)}"]`);
  if (radio && !radio.checked) radio.click();
  mark({ drive: regime.drive, regime: index });
  load();
}

/** Mark a span of the traces, in seconds; null marks what is marked anew. */
export const markSpan = (span) => mark(span ? { drive: own(), span: [...span] } : bench.choice);

let turn = 0;

/** Light up a choice on the map and in the traces. */
export async function mark(choice) {
  const mine = ++turn;
  bench.choice = choice;
  if (!choice) {
    bench.selection = null;
    parts.told.hidden = parts.clear.hidden = true;
    renderMarks();
    await renderTraces();
    return;
  }
  const { drive: shown, from, to, width } = place();
  const found = await attempt(() => postArrays('select', { ...choice, x: bench.x, y: bench.y, shown, start: from, stop: to, width }));
  if (!found || mine !== turn) return;
  bench.selection = found;
  parts.told.textContent = found.sentence;
  parts.told.hidden = parts.clear.hidden = false;
  renderMarks();
  await renderTraces();
}

export function driveChanged() {
  if (!parts) return;
  if (bench.choice && !('span' in bench.choice) && bench.choice.drive !== own()) mark(null);
  else if (bench.choice && 'span' in bench.choice) mark({ ...bench.choice, drive: own() });
  load();
}
