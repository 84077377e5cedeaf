// Effects that no catalogue has: learned shapes with their formulas, used only by a click.

import { attempt, bench, command, h, post, take } from './dom.js';
import { color, draw } from './plot.js';

export function section() {
  const { state } = bench;
  const found = state.learned;
  const offered = !found && state.diagnosis && state.diagnosis.verdict === 'none_of_the_above'; // by the headline
  const begin = offered ? null : h('button', { type: 'button', disabled: Boolean(state.job), onclick: () => attempt(() => post('discover')) }, found ? 'Discover again' : 'Discover what no catalogue has');
  const words = h('p', { class: 'faint' }, 'Where no effect of the catalogue fits, discover learns the shape of what is missing and writes it down as an effect of your own.');
  if (!found) return h('div', {}, h('h3', {}, 'Not in the catalogue?'), words, h('div', { class: 'row' }, begin), command(state.commands.discover));
  const figures = found.shapes.map((shape) => h('figure', { class: 'shape' }, h('figcaption', {}, `${shape.drive}: ${shape.formula}`), h('div', { class: 'plot low', 'data-shape': `${shape.name} ${shape.drive}` })));
  const names = found.found.filter((one) => one.in_file).map((one) => one.name);
  const allowed = state.effect_files.some((one) => one.file === found.path);
  const use = names.length ? h('div', { class: 'selection' },
    h('p', {}, `${found.file} is a program that this page wrote. Using it runs it; read it first if you like.`),
    h('div', { class: 'row' }, h('a', { href: `/api/sessions/${bench.session}/files/${found.file}`, download: found.file }, `Read ${found.file}`),
      allowed ? h('button', { type: 'button', class: 'main', onclick: () => take({ kind: 'add', effects: names }) }, `Add ${names.join(', ')}`)
        : h('button', { type: 'button', onclick: () => take({ kind: 'effects', file: found.path }) }, 'Run this file'))) : null;
  return h('div', {}, h('h3', {}, 'Not in the catalogue?'), h('p', { class: 'verdict', id: 'discovered' }, found.sentence), ...figures, use, h('div', { class: 'row' }, begin), command(state.commands.discover));
}

export function drawShapes() {
  const { learned } = bench.state;
  for (const shape of learned ? learned.shapes : []) {
    const node = document.querySelector(`[data-shape="${CSS.escape(`${shape.name} ${shape.drive}`)}"]`);
    if (!node) continue;
    const edge = (sign) => shape.shape.map((value, index) => value + sign * shape.error[index]);
    draw(node, `Learned shape of ${shape.name} on ${shape.drive}, and its formula ${shape.formula}.`, () => [[
      { type: 'scatter', mode: 'lines', x: [...shape.x, ...[...shape.x].reverse()], y: [...edge(1), ...edge(-1).reverse()], fill: 'toself', fillcolor: color('line'), line: { width: 0 }, opacity: 0.6, hoverinfo: 'skip', name: 'two standard errors' },
      { type: 'scatter', mode: 'lines', x: shape.x, y: shape.shape, name: 'learned shape', line: { color: color('base'), width: 2 } },
      { type: 'scatter', mode: 'lines', x: shape.x, y: shape.drawn, name: 'formula', line: { color: color('better'), width: 2, dash: 'dash' } },
    ], { showlegend: true, margin: { l: 58, r: 12, t: 30, b: 42 }, xaxis: { title: { text: shape.axes[0] }, fixedrange: true }, yaxis: { title: { text: shape.axes[1] }, fixedrange: true } }]);
  }
}
