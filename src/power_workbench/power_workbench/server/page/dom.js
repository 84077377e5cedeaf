// Elements, questions to the server, and what all parts of the page share.

export const bench = {
  session: null, state: null, known: null, drive: null, chosen: false, window: null, x: 'velocity', y: 'torque',
  choice: null, selection: null, preview: null,
};

export const find = (id) => document.getElementById(id);

/** Make an element: attributes, `on…` listeners, `class`, and children. */
export function h(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, '');
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  for (const child of children.flat()) if (child != null) node.append(child);
  return node;
}

export function fill(node, ...children) {
  node.replaceChildren(...children.flat().filter((child) => child != null));
}

const root = () => `/api/sessions/${bench.session}`;

async function answered(response) {
  if (response.ok) return response;
  let text = `The server answered ${response.status}.`;
  try { text = (await response.json()).error || text; } catch { /* keep the number */ }
  const error = new Error(text);
  error.status = response.status;
  throw error;
}

export async function get(path, query = {}) {
  const search = new URLSearchParams(query);
  return (await answered(await fetch(`${root()}/${path}?${search}`))).json();
}

/** Float32 arrays by name, and what else the header says. */
async function arrays(response) {
  const data = await (await answered(response)).arrayBuffer();
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const out = { ...header };
  let place = 4 + length;
  for (const [name, count] of header.arrays) {
    out[name] = new Float32Array(data, place, count);
    place += 4 * count;
  }
  return out;
}

export const getArrays = async (path, query) => arrays(await fetch(`${root()}/${path}?${new URLSearchParams(query)}`));

const posted = (content) => ({ method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(content) });

export const postArrays = async (path, content) => arrays(await fetch(`${root()}/${path}`, posted(content)));

export async function ask(address, content) {
  return (await answered(await fetch(address, content === undefined ? {} : posted(content)))).json();
}

export const post = (path, content = {}) => ask(`${root()}/${path}`, content);

export function tell(text) {
  const node = find('error');
  node.textContent = text || '';
  node.hidden = !text;
}

/** Do something for the user; what goes wrong is said. */
export async function attempt(work) {
  try {
    tell('');
    return await work();
  } catch (error) {
    if (error.name !== 'AbortError') tell(error.message);
    return undefined;
  }
}

export const take = (step) => attempt(() => post('step', step));

export function watts(value) {
  if (value == null) return '–';
  return `${Number(value).toPrecision(3)} W`;
}

export const number = (value) => (value == null ? '–' : Number(Number(value).toPrecision(3)).toString());

export function command(text) {
  if (!text) return null;
  const button = h('button', { type: 'button', 'aria-label': 'Copy this command' }, 'Copy');
  button.addEventListener('click', async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = 'Copied';
    } catch {
      button.textContent = 'Select and copy it';
    }
    setTimeout(() => { button.textContent = 'Copy'; }, 2000);
  });
  return h('div', { class: 'with-copy' }, h('pre', { class: 'command' }, text), button);
}

/** Radio buttons that look like chips. */
export function choices(legend, name, options, value, chosen) {
  return h('fieldset', { class: 'choices' }, h('legend', {}, legend), options.map((option) => h(
    'label', { class: 'choice' },
    h('input', {
      type: 'radio', name, value: option.value, disabled: Boolean(option.disabled), checked: option.value === value,
      onchange: () => chosen(option.value),
    }),
    h('span', {}, option.label),
  )));
}

/** Do the last of many calls only, `wait` ms after it. */
export function settled(work, wait) {
  let timer;
  return (...given) => {
    clearTimeout(timer);
    timer = setTimeout(() => work(...given), wait);
  };
}
