// Where the model fails: regimes in words, a map of the error over two quantities, marks both ways.

import { attempt, bench, choices, fill, find, get, h, postArrays } from './dom.js';
import { color, diverging, draw, on, pictures } from './plot.js';
import { drawPoints, withPoints } from './points.js';
import { place, render as renderTraces } from './traces.js';

const PRESETS = [
  ['velocity', 'torque', 'torque and speed'], ['position', 'velocity', 'position'],
  ['acceleration', 'velocity', 'acceleration'], ['time', 'torque', 'time'],
  ['temperature', 'torque', 'temperature'], ['stride_phase', 'torque', 'phase of the stride'],
];
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
  const axes = h('div', { class: 'row' });
  const box = h('div', { class: 'row' });
  parts = { plot, curve, regimes, told, clear, axes, box };
  fill(find('where-body'),
    h('h3', {}, 'Where the error is largest'),
    h('p', { class: 'faint' }, 'Press one to see it on the map and in the traces.'), regimes,
    told, clear, axes,
    h('div', { class: 'pair' }, plot, h('div', {}, curve, h('p', { class: 'faint', id: 'phases' }))),
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
    h('button', { type: 'button', class: 'link', onclick: () => pick(regime, index) }, `${regime.text} (${regime.seconds.toFixed(0)} s)`))));
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
    select('across', bench.x, (value) => setAxes(value, bench.y)), select('up', bench.y, (value) => setAxes(bench.x, value)));
  const fields = ['x0', 'x1', 'y0', 'y1'].map((key) => h('input', { type: 'number', step: 'any', 'aria-label': { x0: 'Across from', x1: 'Across to', y0: 'Up from', y1: 'Up to' }[key] }));
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
  draw(parts.plot, `Mean error of ${own()} over ${words(bench.x)} and ${words(bench.y)}.`, () => [[
    {
      type: 'heatmap', x: map.x, y: map.y, z: map.z, zmin: -map.limit, zmax: map.limit, colorscale: diverging(),
      colorbar: { title: { text: 'W' }, thickness: 12, len: 0.95 }, hovertemplate: '%{x:.3g}, %{y:.3g}: %{z:.2f} W<extra></extra>',
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
  draw(parts.curve, `Mean error of ${own()} over ${words(bench.x)}.`, () => [[{
    type: 'scatter', mode: 'lines+markers', x: map.curve.map((p) => p[0]), y: map.curve.map((p) => p[1]),
    line: { color: color('base'), width: 2 }, marker: { size: 5 }, hovertemplate: '%{x:.3g}: %{y:.2f} W<extra></extra>',
  }], {
    xaxis: { title: { text: titled(bench.x, map.x_unit) }, fixedrange: true },
    yaxis: { title: { text: 'mean error in W' }, fixedrange: true, zeroline: true },
  }]);
  const groups = map.groups || [];
  find('phases').textContent = groups.length
    ? `By group: ${groups.map((one) => `${one.name} ${one.bias_w > 0 ? '+' : ''}${one.bias_w} W mean, ${one.rmse_w} W rms (${one.seconds} s)`).join('; ')}.` : '';
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
