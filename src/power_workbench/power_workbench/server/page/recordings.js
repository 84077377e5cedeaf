// Recordings: those below the named folders, what is known of those that are open.

import { bench, fill, find, h, number, plural, take } from './dom.js';

export function update() {
  const { state, known } = bench;
  const open = new Set(state.opened);
  const boxes = known.recordings.map((one) => {
    const about = one.problem ? [one.problem] : [one.robot, one.controller, one.drives ? plural(one.drives, 'drive') : '', one.seconds ? `${number(one.seconds)} s` : '', one.date].filter(Boolean);
    return h('li', {}, h('label', {}, h('input', { type: 'checkbox', name: 'bag', value: one.path, checked: open.has(one.path), disabled: Boolean(one.problem) }), ` ${one.name} `, h('span', { class: 'faint' }, about.join(', '))));
  });
  const options = h('details', {}, h('summary', {}, 'When a recording is refused'),
    h('label', { class: 'row' }, h('input', { type: 'checkbox', id: 'slow' }), 'take power that changes less than 25 times a second (--slow-meter)'),
    h('label', { class: 'row' }, h('input', { type: 'checkbox', id: 'anyway' }), 'take signals whose units or signs contradict each other (--ignore-unit-conflicts)'));
  const choose = h('form', { onsubmit: opened },
    h('ul', { class: 'plain' }, boxes.length ? boxes : h('li', {}, 'No recording lies in the folders that were named. Start again with one: ros2 run power_workbench open bags/walk')),
    options, h('div', { class: 'row' }, h('button', { type: 'submit', class: open.size ? '' : 'main' }, open.size ? 'Open these instead' : 'Open')));
  fill(find('recordings-body'),
    state.recordings.map(described),
    open.size ? h('details', {}, h('summary', {}, 'Choose others'), choose) : choose);
}

function opened(event) {
  event.preventDefault();
  const paths = [...event.target.querySelectorAll('input[name="bag"]:checked')].map((box) => box.value);
  take({ kind: 'open', recordings: paths, slow: find('slow').checked, anyway: find('anyway').checked });
}

function described(one) {
  const measured = one.drives.filter((drive) => drive.updates_hz != null);
  const motor = Object.values(one.torque).filter((at) => at === 'motor').length;
  const facts = [
    `${one.seconds.toFixed(0)} s`, ...Object.entries(one.card).map(([key, value]) => `${key} ${value}`),
    measured.length ? `power of ${plural(measured.length, 'drive')}, changing ${number(Math.min(...measured.map((d) => d.updates_hz)))} times a second` : 'power of the whole robot',
    Object.entries(one.rates).map(([topic, rate]) => `${topic} ${number(rate)} Hz`).join(', '),
    motor ? `torque at the motor of ${plural(motor, 'drive')}` : 'torque at the joint',
  ];
  const noted = (one.notes || []).map((note) => `noted ${note.time.slice(11, 19)}: ${note.text}`);
  const marks = [...noted, ...one.findings.map((f) => `${f.severity}: ${f.drive ? `${f.drive}: ` : ''}${f.text}`), ...one.problems];
  return h('div', {}, h('h3', {}, one.name), h('p', { class: 'faint' }, facts.filter(Boolean).join(' · ')),
    marks.length ? h('ul', {}, marks.map((text) => h('li', {}, text))) : h('p', {}, 'Quality: nothing is amiss.'));
}
