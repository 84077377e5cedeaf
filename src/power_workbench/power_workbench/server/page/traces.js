// Measured against model over time: one drive or the sum, a navigator, marks and previews.

import { attempt, bench, choices, command, download, fill, find, get, getArrays, h, post, settled, watts } from './dom.js';
import { color, draw, on, pictures } from './plot.js';
import { judged } from './summary.js';

let parts = null;
let shown = null;
let strip = null;
let mode = 'zoom';
let asked = 0;
let looked = false;
let marked = () => {};
let changed = () => {};

export function start(onMark, onDrive) { marked = onMark; changed = onDrive; }

const whole = () => [0, bench.state.view.seconds];

function build() {
  const plot = h('div', { class: 'plot traces', id: 'plot-traces' });
  const navigator = h('div', { class: 'plot strip', id: 'plot-strip' });
  const drives = h('div', { id: 'drives' });
  const from = h('input', { type: 'number', step: 'any', 'aria-label': 'Span from, in seconds' });
  const to = h('input', { type: 'number', step: 'any', 'aria-label': 'Span to, in seconds' });
  const span = () => [Number(from.value), Number(to.value)];
  const tools = h('div', { class: 'row', role: 'toolbar', 'aria-label': 'View of the traces' },
    choices('Drag to', 'drag', [{ value: 'zoom', label: 'zoom' }, { value: 'mark', label: 'mark a span' }], mode, (value) => { mode = value; render(); }),
    h('button', { type: 'button', onclick: () => zoom(0.5), 'aria-label': 'Zoom in' }, 'In'),
    h('button', { type: 'button', onclick: () => zoom(2), 'aria-label': 'Zoom out' }, 'Out'),
    h('button', { type: 'button', onclick: () => pan(-0.5), 'aria-label': 'Earlier' }, '←'),
    h('button', { type: 'button', onclick: () => pan(0.5), 'aria-label': 'Later' }, '→'),
    h('button', { type: 'button', onclick: () => setWindow(whole()) }, 'Whole recording'),
    pictures(plot, 'traces'), h('button', { type: 'button', onclick: csv }, 'CSV'));
  const exact = h('details', {}, h('summary', {}, 'Exact span'),
    h('div', { class: 'row' }, from, '–', to, 's',
      h('button', { type: 'button', onclick: () => setWindow(span()) }, 'Show'),
      h('button', { type: 'button', onclick: () => marked(span()) }, 'Mark')));
  const legend = h('p', { class: 'faint', id: 'traces-words' });
  const spikes = h('div', { id: 'spikes' });
  const framed = h('button', { type: 'button', class: 'work', onclick: () => leaveOut([bench.window]) }, 'Leave the framed seconds out');
  const hidden = h('div', { id: 'left-out' });
  parts = { plot, navigator, drives, from, to, legend, spikes, framed, hidden };
  plot.tabIndex = 0;
  plot.addEventListener('keydown', (event) => {
    const work = { ArrowLeft: () => pan(-0.25), ArrowRight: () => pan(0.25), '+': () => zoom(0.5), '-': () => zoom(2), Home: () => setWindow(whole()) }[event.key];
    if (work) { event.preventDefault(); work(); }
  });
  fill(find('traces-body'), drives, tools, plot, legend,
    h('p', { class: 'faint' }, 'The whole recording: the stronger the colour, the larger the error of that drive. Drag across it to look at a part, press a row to see its drive.'),
    navigator, h('div', { class: 'row' }, framed), hidden, spikes, exact);
}

const leaveOut = (spans) => attempt(() => post('leave_out', { spans }));

/** Seconds that are left out, how to take them in again, and the command that leaves them out. */
export function leftOut() {
  const { state } = bench;
  const { hidden } = state.view;
  const coarse = state.view.share < 1;
  parts.framed.disabled = coarse || Boolean(state.job);
  for (const button of parts.spikes.querySelectorAll('button.work')) button.disabled = Boolean(state.job);
  const step = state.steps.slice(0, state.at).findLastIndex((one) => one.kind === 'open');
  fill(parts.hidden, hidden.length ? [h('p', {}, `Left out of all that is judged, grey in the strip: ${hidden.map(([a, b]) => `${a.toFixed(1)} to ${b.toFixed(1)} s`).join(', ')}. `,
    h('button', { type: 'button', class: 'work', disabled: Boolean(state.job), onclick: () => attempt(() => post('leave_out', { spans: [] })) }, 'Take them in again')),
  step >= 0 ? command(state.steps[step].command) : null] : null);
}

function csv() {
  const { t, measured, estimate, error } = shown;
  const rows = [...t].map((time, index) => [time, measured[index], ...(error ? [estimate[index], error[index]] : [])].map((value) => Number(value.toPrecision(6))).join(','));
  download(`${bench.drive}.csv`, `time_s,measured_w${error ? ',model_w,error_w' : ''}\n${rows.join('\n')}\n`);
}

function zoom(factor) {
  const [a, b] = bench.window;
  const half = 0.5 * factor * (b - a);
  setWindow([0.5 * (a + b) - half, 0.5 * (a + b) + half]);
}

function pan(share) {
  const [a, b] = bench.window;
  const step = share * (b - a);
  setWindow([a + step, b + step]);
}

function setWindow([a, b]) {
  const [, end] = whole();
  const length = Math.min(Math.max(Math.abs(b - a), 0.2), end);
  const first = Math.min(Math.max(Math.min(a, b), 0), end - length);
  bench.window = [first, first + length];
  looked = true;
  load();
}

function drives() {
  const { view } = bench.state;
  const scores = view.scores ? view.scores.drives : {};
  const error = (name) => (scores[name] ? scores[name].rmse_w : null);
  const names = [...view.meters].sort((a, b) => (error(b) || 0) - (error(a) || 0));
  const options = names.map((name) => ({ value: name, label: error(name) == null ? name : `${name} ${watts(error(name))}` }));
  if (names.length > 1) {
    const total = view.scores ? view.scores.total.rmse_w : null;
    options.push({ value: 'sum', label: total == null ? 'sum' : `sum ${watts(total)}` });
  }
  // Until somebody chooses, the drive that fails most is shown.
  if (!bench.chosen || !options.some((option) => option.value === bench.drive)) bench.drive = names[0];
  fill(parts.drives, choices('Drive', 'drive', options, bench.drive, setDrive));
}

function setDrive(name) {
  bench.chosen = true;
  bench.drive = name;
  for (const input of parts.drives.querySelectorAll('input')) input.checked = input.value === name;
  load();
  moments();
  changed();
}

export function update() {
  const fresh = !parts;
  if (fresh) build();
  drives();
  const [, end] = whole();
  if (!bench.window || bench.window[1] > end + 0.1 || !looked) bench.window = [...bench.state.view.worst];
  load();
  moments();
  loadStrip();
}

export const place = () => ({
  drive: bench.drive, from: bench.window[0], to: bench.window[1],
  width: Math.round(parts.plot.clientWidth || 800),
});

/** Spikes and stretches of the shown drive in words, with what to press. */
async function moments() {
  const drive = bench.drive;
  const found = bench.state.view.scores && bench.state.view.drives.includes(drive) ? await attempt(() => get('moments', { drive })) : null;
  if (drive !== bench.drive) return;
  const each = bench.state.view.by_recording;
  fill(parts.spikes, each.length ? h('p', { class: 'faint' }, `By recording: ${each.map((one) => `${one.name.split('/').pop()} ${watts(one.rmse_w)} rms of ${watts(one.mean_w)}`).join('; ')}.`) : null, found ? [found.spikes ? h('p', {}, found.spikes) : null,
    h('ul', { class: 'plain' }, found.stretches.map((one) => h('li', {}, h('button', { type: 'button', class: 'link', onclick: () => setWindow([one.start - 1, one.stop + 1]) }, one.words), ' ',
      h('button', { type: 'button', class: 'work', disabled: Boolean(bench.state.job), 'aria-label': `Leave ${one.start} to ${one.stop} s out`, onclick: () => leaveOut([[one.start, one.stop]]) }, 'Leave these seconds out'))))] : null);
}

async function load() {
  const turn = ++asked;
  const found = await attempt(() => getArrays('traces', place()));
  if (!found || turn !== asked) return;
  shown = found;
  render();
  drawStrip();
  if (bench.choice) marked(null);
}

function line(x, y, name, tone, axis, width = 1.5, more = {}) {
  return { x, y, name, type: 'scatter', mode: 'lines', yaxis: axis, line: { color: color(tone), width }, hovertemplate: '%{x:.2f} s: %{y:.2f} W<extra>' + name + '</extra>', connectgaps: false, ...more };
}

function traces() {
  const data = [line(shown.t, shown.measured, 'measured', 'measured', 'y', 2)];
  if (shown.estimate) {
    data.push(line(shown.t, shown.estimate, 'model', 'base', 'y', 1.4));
    data.push(line(shown.t, shown.error, 'error (model − measured)', 'base', 'y2', 1.2, { showlegend: false }));
  }
  const { preview, selection } = bench;
  if (preview && shown.error) data.push(line(preview.t, preview.preview, `error with ${preview.words}`, 'third', 'y2', 1.6));
  if (selection) {
    data.push(line(selection.lit_t, selection.lit_measured, 'marked', 'lit', 'y', 3.5));
    if (selection.lit_error) data.push(line(selection.lit_t, selection.lit_error, 'marked', 'lit', 'y2', 2.5, { showlegend: false }));
  }
  return data;
}

export function render() {
  if (!shown || !parts) return null;
  const two = Boolean(shown.error);
  const words = two
    ? `Power of ${bench.drive} from ${bench.window[0].toFixed(1)} to ${bench.window[1].toFixed(1)} seconds, measured and model, with the error below.`
    : `Measured power of ${bench.drive}.`;
  const noise = bench.state.view.noise[bench.state.view.meters.indexOf(bench.drive)];
  const done = draw(parts.plot, words, () => [traces(), {
    showlegend: true, dragmode: mode === 'zoom' ? 'zoom' : 'select', selectdirection: 'h',
    selections: [],
    margin: { l: 58, r: 12, t: 30, b: 42 },
    xaxis: { title: { text: 'time in s' }, range: [...bench.window], anchor: two ? 'y2' : 'y' },
    yaxis: { title: { text: 'power in W' }, domain: two ? [0.42, 1] : [0, 1], fixedrange: true, autorange: true },
    ...(two ? { yaxis2: { title: { text: 'error in W' }, domain: [0, 0.36], fixedrange: true, autorange: true, zeroline: true } } : {}),
    shapes: two && noise ? [{ type: 'rect', xref: 'paper', x0: 0, x1: 1, yref: 'y2', y0: -2 * noise, y1: 2 * noise, line: { width: 0 }, fillcolor: color('line'), opacity: 0.5, layer: 'below' }] : [],
  }]);
  on(parts.plot, 'plotly_relayout', (event) => {
    if (event['xaxis.range[0]'] != null) setWindow([event['xaxis.range[0]'], event['xaxis.range[1]']]);
  });
  on(parts.plot, 'plotly_selected', (event) => { if (event && event.range && event.range.x) marked(event.range.x); });
  on(parts.plot, 'plotly_doubleclick', () => setWindow(whole()));
  [parts.from.value, parts.to.value] = bench.window.map((value) => value.toFixed(2));
  const coarse = bench.state.view.share < 1;
  const { worst, scores } = bench.state.view;
  const score = two && (bench.drive === 'sum' ? scores.total : scores.drives[bench.drive]);
  const own = bench.window.every((value, index) => Math.abs(value - worst[index]) < 0.05);
  parts.legend.textContent = two
    ? `${score && score.rmse_w != null ? `${bench.drive}: the model ${judged(score)}. ` : ''}${own ? 'Shown are the seconds in which it is worst. ' : ''}Grey: the meter’s noise, which no model can follow.`
    : coarse ? `A first look: one part in ${Math.round(1 / bench.state.view.share)} of the recording, evenly spread, as it was measured. The whole of it is being read.`
    : 'The part of twelve seconds with the most power. Fit or load a model above to see it beside the measurement.';
  return done;
}

const loadStrip = settled(async () => {
  strip = await attempt(() => get('strip', { width: Math.round((parts.navigator.clientWidth || 800) / 4) }));
  drawStrip();
}, 30);

function drawStrip() {
  if (!strip || !bench.window) return;
  const rows = strip.z.map((row) => row.filter((value) => value != null)).flat().sort((a, b) => a - b);
  const top = rows[Math.floor(0.98 * rows.length)] || 1;
  parts.navigator.style.height = `${Math.max(6, 3.4 + 1.15 * strip.meters.length)}rem`;
  const names = strip.meters;
  draw(parts.navigator, 'Error of every drive over the whole recording; the part that is shown above is framed.', () => [[
    {
      type: 'heatmap', x: strip.t, y: names, z: strip.z, zmin: 0, zmax: top, showscale: false,
      colorscale: [[0, color('grid')], [1, color('base')]], hovertemplate: '%{y}, %{x:.1f} s: %{z:.2f} W<extra></extra>', ygap: 1,
    },
    { type: 'scatter', mode: 'markers', x: strip.t, y: strip.t.map(() => names[0]), marker: { opacity: 0 }, hoverinfo: 'skip' },
  ], {
    dragmode: 'select', selectdirection: 'h', selections: [], margin: { l: 74, r: 12, t: 4, b: 36 },
    xaxis: { title: { text: 'time in s' }, range: whole(), fixedrange: true },
    yaxis: { fixedrange: true, autorange: 'reversed', type: 'category' },
    shapes: [...bench.state.view.hidden.map(([x0, x1]) => ({ type: 'rect', xref: 'x', x0, x1, yref: 'paper', y0: 0, y1: 1, line: { color: color('text'), width: 1, dash: 'dot' }, fillcolor: color('line'), opacity: 0.8, label: { text: 'left out', font: { size: 11, color: color('text') } } })), { type: 'rect', xref: 'x', x0: bench.window[0], x1: bench.window[1], yref: 'paper', y0: 0, y1: 1, line: { color: color('text'), width: 2 } }],
  }]);
  on(parts.navigator, 'plotly_selected', (event) => { if (event && event.range && event.range.x) setWindow(event.range.x); });
  on(parts.navigator, 'plotly_click', (event) => { const name = event.points[0].y; if (name !== bench.drive) setDrive(name); });
}

window.addEventListener('resize', settled(() => { if (parts && bench.state.view) { load(); loadStrip(); } }, 250));
