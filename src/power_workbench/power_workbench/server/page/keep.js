// Keep: files of the session and the commands that do the same.

import { attempt, bench, command, fill, find, h, post } from './dom.js';

export function update() {
  const { state } = bench;
  const done = state.steps.slice(0, state.at);
  const file = (name, text) => h('li', {}, h('a', { href: `/api/sessions/${bench.session}/files/${name}`, download: name }, name), `: ${text}`);
  const words = { session: 'the session as a file of its steps', report: 'report, one page that needs no network', next: 'motion to record next', import: 'map of an imported log', notes: 'notes taken while the robot ran', effects: 'effects of your own, a program', model: 'model' };
  const files = state.files.map((name) => file(name, name === state.model_file ? 'the present model' : words[name.split(/[_.]/)[0]]));
  fill(find('keep-body'),
    h('div', { class: 'row' }, h('button', { type: 'button', disabled: Boolean(state.job), onclick: () => attempt(() => post('report')) }, 'Write the report')),
    h('ul', { class: 'plain' }, files),
    h('p', { class: 'faint' }, `All of it lies in ${state.folder}. To take the same steps to the same numbers again:`),
    command(`ros2 run power_workbench replay_session ${state.folder}`),
    h('h3', {}, 'The commands that do the same'),
    command(done.map((step) => step.command).filter(Boolean).join('\n')),
    state.commands.compare ? command(state.commands.compare) : null);
}
