// What to record next: the motion as a plot, run on the simulated bench or by a command.

import { attempt, bench, command, fill, find, h, post, take } from './dom.js';
import { color, draw } from './plot.js';

const SHORT = 300; // s
const SIMULATED = /^anymal_c/;

/** Speed and load over time of the segments, as corners of lines. */
function profile(segments) {
  const t = [];
  const speed = [];
  const load = [];
  let now = 0;
  const corner = (time, w, m) => { t.push(time); speed.push(w); load.push(m); };
  for (const one of segments) {
    const end = now + one.seconds;
    const m = one.load ?? one.torque ?? 0;
    if (one.frequency) {
      const count = Math.min(200, Math.ceil(8 * one.frequency * one.seconds));
      for (let i = 0; i <= count; i += 1) {
        const at = (i / count) * one.seconds;
        const phase = 2 * Math.PI * one.frequency * at;
        if (one.mode === 'torque') corner(now + at, 0, Math.sin(phase) >= 0 ? one.high : one.low);
        else corner(now + at, 2 * Math.PI * one.frequency * (one.amplitude || 0) * Math.cos(phase), m);
      }
    } else {
      corner(now, one.speed || 0, m);
      corner(end, one.speed || 0, m);
    }
    now = end;
  }
  return { t, speed, load };
}

export function update() {
  const { state } = bench;
  const motion = state.diagnosis.next_recording;
  const drives = h('select', { 'aria-label': 'Drive of the bench' }, motion.drives.map((name) => h('option', { value: name }, name)));
  const long = motion.seconds > 1.5 * SHORT;
  const length = h('select', { 'aria-label': 'Length of the motion' },
    h('option', { value: '' }, `all ${Math.round(motion.seconds / 60)} min of it`), h('option', { value: SHORT }, `cut to ${SHORT / 60} min: wider intervals`));
  const run = () => attempt(() => post('bench', { drive: drives.value, ...(long && length.value ? { seconds: Number(length.value) } : {}) }));
  const simulated = state.recordings.some((one) => SIMULATED.test(one.card.robot || ''));
  const made = state.made.map((path) => h('li', {}, `${path.split('/').pop()}: `,
    h('button', { type: 'button', onclick: () => take({ kind: 'open', recordings: [path] }) }, 'Open it'), ' ',
    h('button', { type: 'button', onclick: () => take({ kind: 'open', recordings: [...state.opened, path] }) }, 'Open it with the present ones')));
  fill(find('next-body'),
    h('p', { id: 'next-reason' }, `${Math.round(motion.seconds)} s ${motion.reason}.`),
    motion.repeat_at_supply_voltage ? h('p', {}, `Repeat it at a supply of ${motion.repeat_at_supply_voltage.join(' V and ')} V.`) : null,
    h('div', { class: 'plot low', id: 'plot-motion' }),
    simulated ? h('div', { class: 'row' }, drives, ...(long ? [length] : []), h('button', { type: 'button', disabled: Boolean(state.job), onclick: run }, 'Record it on the simulated bench')) : null,
    made.length ? h('div', {}, h('h3', {}, 'Recorded'), h('ul', { class: 'plain' }, made)) : null,
    h('p', { class: 'faint' }, simulated ? 'On a drive, fitted to the limits of its joint:' : 'Fitted to the limits of the joint, then run on it:'),
    command(`${state.commands.motion}\nros2 run drive_bench run next.yaml --record bags/next`));
  const p = profile(motion.segments);
  draw(find('plot-motion'), `Speed and load of the proposed motion of ${Math.round(motion.seconds)} seconds.`, () => [[
    { type: 'scatter', mode: 'lines', name: 'speed in rad/s', x: p.t, y: p.speed, line: { color: color('better'), width: 1.5 } },
    { type: 'scatter', mode: 'lines', name: 'load in N·m', x: p.t, y: p.load, yaxis: 'y2', line: { color: color('base'), width: 1.5, dash: 'dot' } },
  ], {
    showlegend: true, margin: { l: 58, r: 66, t: 30, b: 42 },
    xaxis: { title: { text: 'time in s' }, fixedrange: true }, yaxis: { title: { text: 'speed in rad/s' }, fixedrange: true },
    yaxis2: { overlaying: 'y', side: 'right', fixedrange: true, showgrid: false, automargin: true, title: { text: 'load in N·m', standoff: 12 } },
  }]);
}
