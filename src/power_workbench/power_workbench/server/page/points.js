// Points over a plot, on a canvas of their own: Plotly would draw all of the plot anew for them.

import { color } from './plot.js';

const SIZE = 4; // px
const OPACITY = 0.75;

/** Draw points at x and y of the plot's axes, in place of those before. */
export function drawPoints(plot, x, y) {
  const full = plot._fullLayout;
  if (!full || !full.xaxis) return;
  let canvas = plot.querySelector(':scope > canvas');
  if (!canvas) {
    canvas = document.createElement('canvas');
    canvas.setAttribute('aria-hidden', 'true');
    plot.append(canvas);
  }
  const scale = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [full.width * scale, full.height * scale];
  [canvas.style.width, canvas.style.height] = [`${full.width}px`, `${full.height}px`];
  const { xaxis, yaxis } = full;
  const pen = canvas.getContext('2d');
  pen.scale(scale, scale);
  pen.beginPath();
  pen.rect(xaxis._offset, yaxis._offset, xaxis._length, yaxis._length);
  pen.clip();
  pen.globalAlpha = OPACITY;
  pen.fillStyle = color('lit');
  for (let i = 0; i < x.length; i += 1) {
    if (Number.isFinite(x[i]) && Number.isFinite(y[i])) {
      pen.fillRect(xaxis._offset + xaxis.l2p(x[i]) - SIZE / 2, yaxis._offset + yaxis.l2p(y[i]) - SIZE / 2, SIZE, SIZE);
    }
  }
}

/** Layout of a picture of the plot that has the points in it: dashes of one path. */
export function withPoints(plot, x, y) {
  const { xaxis } = plot._fullLayout;
  const dash = (SIZE * (xaxis.range[1] - xaxis.range[0])) / xaxis._length;
  let path = '';
  for (let i = 0; i < x.length; i += 1) {
    if (Number.isFinite(x[i]) && Number.isFinite(y[i])) path += `M${x[i] - dash / 2},${y[i]}L${x[i] + dash / 2},${y[i]}`;
  }
  return path ? { shapes: [{ type: 'path', path, opacity: OPACITY, line: { color: color('lit'), width: SIZE } }] } : {};
}
