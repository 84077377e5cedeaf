(function () {
  'use strict';
  var content = JSON.parse(document.getElementById('figures').textContent);
  var figures = content.figures, names = content.colors;
  var drawn = {};
  function color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
  }
  function painted(value) {
    if (typeof value === 'string' && names[value]) return color(names[value]);
    if (Array.isArray(value)) {
      return value.length && typeof value[0] === 'number' ? value : value.map(painted);
    }
    if (value && typeof value === 'object') {
      var out = {};
      Object.keys(value).forEach(function (key) { out[key] = painted(value[key]); });
      return out;
    }
    return value;
  }
  function draw(id) {
    var figure = painted(figures[id]);
    Plotly.react(id, figure.data, figure.layout, {
      responsive: true, displaylogo: false, displayModeBar: 'hover', scrollZoom: false,
      modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d']
    });
    drawn[id] = true;
  }
  function visible(node) { return node.offsetParent !== null; }
  function drawVisible(again) {
    Object.keys(figures).forEach(function (id) {
      var node = document.getElementById(id);
      if (visible(node) && (again || !drawn[id])) draw(id);
      else if (again) drawn[id] = false;
    });
  }
  document.querySelectorAll('.tabs').forEach(function (tabs) {
    tabs.addEventListener('click', function (event) {
      var button = event.target.closest('button');
      if (!button) return;
      tabs.querySelectorAll('button').forEach(function (other) {
        var on = other === button;
        other.setAttribute('aria-selected', on ? 'true' : 'false');
        document.getElementById(other.dataset.panel).hidden = !on;
      });
      drawVisible(false);
    });
  });
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', function () {
    drawVisible(true);
  });
  window.addEventListener('beforeprint', function () { drawVisible(true); });
  window.addEventListener('afterprint', function () { drawVisible(true); });
  drawVisible(false);
  document.body.dataset.ready = 'yes';
})();
