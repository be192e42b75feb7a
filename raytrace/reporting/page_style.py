"""Style and script of a report's page: readable on a projector of 1920 x 1080 pixels and on a phone, light or dark."""

STYLE = """
:root { color-scheme: light dark; --ink: #111; --paper: #fff; --soft: #555; --line: #ccc; --box: #e9f2fa;
  --accent: #0072b2; --front: #fff0cc; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #15181c; --soft: #a8a8a8; --line: #444;
  --box: #1d2a36; --accent: #56b4e9; --front: #3d3312; } }
body { font: 22px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1860px; padding: .8em; color: var(--ink);
  background: var(--paper); overflow-wrap: anywhere; }
h1 { margin: 0; line-height: 1.2; } h2 { margin: 1.3em 0 .4em; line-height: 1.2; } p { margin: .5em 0; }
a { color: var(--accent); }
.advice { font-size: 1.25em; background: var(--box); border-left: .3em solid var(--accent); padding: .5em .8em; }
.plots, .pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 620px), 1fr)); gap: 1em; }
.plots img { width: 100%; max-height: 94vh; object-fit: contain; }
.crops { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(46%, 250px), 1fr)); gap: .8em; }
.crops figure { margin: 0; } .crops figcaption { font-size: .82em; line-height: 1.3; }
.crops canvas, .crops .whole { display: block; width: 100%; image-rendering: pixelated; margin-bottom: .3em; }
.both { position: relative; overflow: hidden; cursor: ew-resize; touch-action: pan-y; user-select: none; }
.both img { display: block; width: 100%; image-rendering: pixelated; pointer-events: none; }
.both img.b { position: absolute; inset: 0; height: 100%; }
.both i { position: absolute; top: 0; bottom: 0; width: 2px; margin-left: -1px; background: #fff;
  box-shadow: 0 0 3px #000; }
select, input { font: inherit; max-width: 100%; } input[type=range] { width: 100%; margin: 0; }
.scale { height: .8em; } .scale + div { display: flex; justify-content: space-between; font-size: .8em; }
table { border-collapse: collapse; } td, th { padding: .2em .5em; text-align: right; white-space: nowrap; }
tr { border-bottom: 1px solid var(--line); } td:first-child, th:first-child { text-align: left; }
table.all { font-size: .78em; } .costs { font-size: .9em; } tr.front { background: var(--front); }
tr:hover { outline: 1px solid var(--soft); } td img { display: block; height: 5em; }
.wide { overflow-x: auto; } small, .quiet { color: var(--soft); font-size: .82em; }
td:first-child, th:first-child { position: sticky; left: 0; background: inherit; } tr { background: var(--paper); }
@media (max-width: 700px) { body { font-size: 16px; } .plots picture { display: block; overflow-x: auto; }
  .plots img { width: 640px; max-height: none; }
  td:first-child:not(:has(img)) { white-space: normal; min-width: 9.6em; } }
"""
SCRIPT = """
const shown = JSON.parse(document.getElementById('shown').textContent);
const [one, other, where] = ['one', 'other', 'where'].map(id => document.getElementById(id));
const boxes = [...document.querySelectorAll('.both')];
shown.forEach((image, k) => { for (const list of [one, other]) list.add(new Option(image.name, k)); });
one.value = Math.min(1, shown.length - 1); other.value = 0;
function update() {
  boxes.forEach(box => {
    const kind = box.dataset.kind, [a, b] = box.querySelectorAll('img');
    a.src = shown[other.value][kind]; b.src = shown[one.value][kind];
    b.style.clipPath = `inset(0 ${100 - where.value}% 0 0)`; box.querySelector('i').style.left = where.value + '%';
  });
}
function moveLine(event) {
  const at = event.currentTarget.getBoundingClientRect();
  if (event.type == 'pointerdown') event.currentTarget.setPointerCapture(event.pointerId);
  if (event.buttons) { where.value = 100 * (event.clientX - at.left) / at.width; update(); }
}
boxes.forEach(box => { box.onpointerdown = moveLine; box.onpointermove = moveLine; });
for (const control of [one, other, where]) control.oninput = update;
update();
"""
