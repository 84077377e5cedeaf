// Power over the motion: efficiency over torque and speed, and a leg's power over the gait cycle.

import { choices, fill, h, percent, watts } from './dom.js';
import { color, draw, keys, ofFamily, pictures } from './plot.js';

let type = '';
let parts = null;

function build(node) {
  parts = {
    map: h('div', { class: 'plot map', id: 'plot-efficiency' }), cycle: h('div', { class: 'plot map', id: 'plot-gait' }),
    ways: h('div', { class: 'row' }), legend: h('ul', { class: 'legend' }),
  };
  parts.efficiency = h('div', {}, h('h3', {}, 'Efficiency over torque and speed'), parts.ways, parts.map,
    h('p', { class: 'faint' }, 'By the model in steady motion; dots are states of the recording, driving above 0 and braking below.'), h('div', { class: 'row' }, pictures(parts.map, 'efficiency', 'Efficiency')));
  parts.gait = h('div', {}, h('h3', {}, 'Power of one leg over the gait cycle'), parts.legend, parts.cycle,
    h('p', { class: 'faint' }, 'From touch-down to touch-down, mean over legs and strides.'), h('div', { class: 'row' }, pictures(parts.cycle, 'gait', 'Gait cycle')));
  fill(node, parts.efficiency, parts.gait);
}

/** Pictures of a budget { efficiency, gait } in a node; what a budget lacks is hidden. */
export function motion(node, { efficiency, gait, rows }, families) {
  if (!parts) build(node);
  const drawn = (name) => rows.filter((row) => row.drive === name && row.phase === 'all').reduce((sum, row) => sum + row.mean_w, 0);
  efficiency.sort((a, b) => drawn(b.name) - drawn(a.name));
  parts.efficiency.hidden = !efficiency.length;
  parts.gait.hidden = !gait;
  if (efficiency.length) {
    if (!efficiency.some((one) => one.name === type)) type = efficiency[0].name;
    const show = () => {
      fill(parts.ways, efficiency.length > 1 ? choices('Drives', 'efficiency-of', efficiency.map((one) => ({ value: one.name, label: one.name })), type, (name) => { type = name; show(); }) : null);
      efficient(parts.map, efficiency.find((one) => one.name === type));
    };
    show();
  }
  if (gait) stride(parts.cycle, parts.legend, gait, families);
}

function efficient(node, one) {
  const best = Math.max(...one.percent.flat());
  draw(node, `Efficiency of ${one.name} over torque and speed, at most ${percent(best / 100)}.`, () => [[
    { type: 'heatmap', x: one.speed, y: one.torque, z: one.percent, zmin: 0, zmax: 100, colorscale: 'Cividis', colorbar: { title: { text: '%' }, thickness: 12 }, hovertemplate: '%{x:.2f} rad/s, %{y:.1f} N·m: %{z:.0f} %<extra></extra>' },
    { type: 'scatter', mode: 'markers', x: one.states.map((at) => at[0]), y: one.states.map((at) => at[1]), marker: { size: 3, color: '#fff', opacity: 0.45 }, hoverinfo: 'skip' },
  ], {
    margin: { l: 58, r: 12, t: 10, b: 42 },
    xaxis: { title: { text: 'speed in rad/s' }, range: [one.speed[0], one.speed.at(-1)], fixedrange: true },
    yaxis: { title: { text: 'torque along the motion in N·m' }, range: [one.torque[0], one.torque.at(-1)], fixedrange: true, zeroline: true },
  }]);
}

/** Stacked areas: what a part takes upward, what it gives back downward. */
function stride(node, legend, gait, families) {
  const shown = families.filter((one) => gait.families[one.name]?.some((value) => Math.abs(value) > 0.05));
  keys(legend, shown);
  const mean = gait.metered.reduce((sum, value) => sum + value, 0) / gait.metered.length;
  draw(node, `Power of one leg over the gait cycle, ${watts(mean)} in the mean, ${watts(Math.max(...gait.metered))} at most.`, () => [[
    ...shown.flatMap((one) => [1, -1].map((sign) => ({
      type: 'scatter', mode: 'none', stackgroup: sign > 0 ? 'up' : 'down', x: gait.percent, y: gait.families[one.name].map((value) => (Math.sign(value) === sign ? value : 0)),
      fillcolor: ofFamily(one), name: one.words, hoverinfo: 'skip',
    }))),
    { type: 'scatter', mode: 'lines', x: gait.percent, y: gait.metered, line: { color: color('text'), width: 2 }, name: 'metered', hovertemplate: '%{x:.0f} %: %{y:.3~g} W<extra>metered</extra>' },
  ], {
    xaxis: { title: { text: 'gait cycle in %' }, range: [0, 100], fixedrange: true }, yaxis: { title: { text: 'power of one leg in W' }, fixedrange: true, zeroline: true },
    shapes: [{ type: 'line', x0: gait.stance, x1: gait.stance, y0: 0, y1: 1, yref: 'paper', line: { color: color('faint'), dash: 'dot', width: 1 } }],
    annotations: [{ x: gait.stance, y: 1, yref: 'paper', xanchor: 'left', yanchor: 'top', showarrow: false, text: ' foot lifts', font: { size: 12, color: color('faint') } }],
  }]);
}
