# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Style sheet and WebGL 2 viewer of ``report.html``."""

from ivfmc_ros.inspection.reports.color_scale import glsl

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1180px; padding: 0 16px;
  color: #1c2530; background: #fff }
h1 { font-size: 22px; margin: 18px 0 4px } h2 { font-size: 17px; margin: 26px 0 8px }
h3 { font-size: 15px; margin: 14px 0 4px } .wide { overflow-x: auto; margin-bottom: 10px }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
td, th { padding: 2px 10px; text-align: right; border-bottom: 1px solid #dde3ea }
td:first-child, th:first-child { text-align: left; white-space: nowrap }
.pass { color: #0a7d32 } .fail { color: #c22020; font-weight: 600 } .not, .no { color: #9a6b00 }
#view { width: 100%; height: 560px; background: #f4f6f8; touch-action: none; cursor: grab;
  display: block }
svg { display: block; max-width: 100%; height: auto } .bar { margin: 8px 0 }
.row { display: flex; flex-wrap: wrap; gap: 20px } img { max-width: 100% }
figure { margin: 0; min-width: 0 } figcaption { color: #5a6675; font-size: 13px }
.section figcaption { max-width: 430px }
.banner { font-size: 34px; font-weight: 700; text-align: center; padding: 6px; margin: 12px 0 0;
  border-radius: 4px; background: #e6e8eb }
.banner.pass { background: #0b5d1e; color: #fff } .banner.fail { background: #8f1010; color: #fff }
.banner.not, .banner.no { background: #ffd966; color: #1a1a1a }
.heading { display: grid; grid-template-columns: repeat(auto-fill, minmax(220px, 1fr));
  gap: 2px 18px; margin: 8px 0 14px; border: 1px solid #dde3ea; padding: 8px 12px }
.heading dt { color: #5a6675; font-size: 12px } .heading dd { margin: 0 0 4px }
.heading .blank { border-bottom: 1px solid #5a6675 }
details { border-top: 1px solid #dde3ea } summary { cursor: pointer }
summary h2 { display: inline-block; margin: 10px 0 } .print { display: none }
.line { white-space: nowrap } .sentence { display: inline-block; min-width: 14em;
  text-align: left }
@media (max-width: 600px) { body { padding: 0 8px } #view { height: 320px }
  .banner { font-size: 26px }
  td, th { padding: 2px 5px; font-size: 13px } .row img { width: 100% } }
@media print { @page { size: A4; margin: 12mm }
  body { font-size: 9.5px; max-width: none; padding: 0 } h1 { font-size: 16px; margin: 6px 0 2px }
  h2, summary h2 { font-size: 12px; margin: 8px 0 3px } .banner { font-size: 26px; margin: 0 }
  .screen, details:not([open]), tr.unprinted { display: none } .print { display: block }
  tr.print { display: table-row } td, th { padding: 0 4px }
  .sentence { min-width: 42mm } summary { list-style: none }
  .print img { max-height: 105mm } .heading { grid-template-columns: repeat(5, 1fr);
  margin: 4px 0; padding: 4px 8px } .heading dt { font-size: 8.5px }
  .row { display: grid; grid-template-columns: 1fr 1fr; gap: 6px 12px }
  .row img, .labeled { max-height: 80mm } .labeled { width: 100% } .wide { overflow: visible }
  .histogram { width: 120mm } .bar { width: 110mm } figcaption { font-size: 8.5px }
  figure, tr, svg { break-inside: avoid } h2, summary { break-after: avoid }
  .banner, .pass, .fail { -webkit-print-color-adjust: exact; print-color-adjust: exact } }
"""

# Positions come as 16 bit shares of the box, colors as 8 bit (255: no value), corners as 32 bit.
PROGRAM = """
'use strict';
(function () {
  const data = JSON.parse(document.getElementById('mesh').textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const canvas = document.getElementById('view');
  const gl = canvas.getContext('webgl2', { antialias: true, preserveDrawingBuffer: true });
  const state = document.getElementById('state');
  if (!gl) { state.textContent = 'This browser has no WebGL 2.'; return; }
  const shader = (kind, source) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, source); gl.compileShader(made);
    if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) {
      throw new Error(gl.getShaderInfoLog(made));
    }
    return made;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `#version 300 es
    in vec3 place; in float value; uniform mat4 camera; uniform vec3 size;
    out vec3 at; out float shown;
    void main() {
      at = (place - 0.5) * size; shown = value * 255.0; gl_Position = camera * vec4(at, 1.0);
    }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float; in vec3 at; in float shown; uniform vec3 eye; uniform int plain;
    out vec4 color;
    @MAP@
    void main() {
      vec3 n = normalize(cross(dFdx(at), dFdy(at)));
      float light = 0.35 + 0.65 * abs(dot(n, normalize(eye - at)));
      vec3 base = shown > 254.5 || plain == 1 ? vec3(0.72, 0.75, 0.78) : map(shown / 254.0);
      color = vec4(base * light, 1.0);
    }`));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(gl.getProgramInfoLog(program));
  }
  gl.useProgram(program);
  const fill = (name, array, count, kind) => {
    const place = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, count, kind, true, 0, 0);
  };
  fill('place', new Uint16Array(bytes(data.places)), 3, gl.UNSIGNED_SHORT);
  fill('value', new Uint8Array(bytes(data.values)), 1, gl.UNSIGNED_BYTE);
  const corners = new Uint32Array(bytes(data.corners));
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
  gl.enable(gl.DEPTH_TEST);
  const reach = Math.hypot(...data.size) / 2;
  let turn = 0.6, tilt = 0.45, far = 2.4 * reach, shift = [0, 0], plain = 0;
  const at = (name) => gl.getUniformLocation(program, name);
  const multiply = (a, b) => {
    const out = new Float32Array(16);
    for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) {
      for (let k = 0; k < 4; k++) out[4 * i + j] += a[4 * k + j] * b[4 * i + k];
    }
    return out;
  };
  const draw = () => {
    const w = canvas.clientWidth, h = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(w * ratio)) {
      canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio);
    }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.957, 0.965, 0.973, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const ct = Math.cos(turn), st = Math.sin(turn), ce = Math.cos(tilt), se = Math.sin(tilt);
    const right = [-st, ct, 0], up = [-ct * se, -st * se, ce], back = [ct * ce, st * ce, se];
    const look = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0,
      right[2], up[2], back[2], 0, shift[0], shift[1], -far, 1];
    const f = 1 / Math.tan(0.35), near = far / 50, end = far + 3 * reach;
    const lens = [f * h / w, 0, 0, 0, 0, f, 0, 0, 0, 0, (near + end) / (near - end), -1,
      0, 0, 2 * near * end / (near - end), 0];
    gl.uniformMatrix4fv(at('camera'), false, multiply(lens, look));
    gl.uniform3fv(at('size'), data.size);
    gl.uniform3fv(at('eye'), back.map((x) => x * far));
    gl.uniform1i(at('plain'), plain);
    gl.drawElements(gl.TRIANGLES, corners.length, gl.UNSIGNED_INT, 0);
    state.textContent = (corners.length / 3).toLocaleString('en') +
      ' triangles; drag turns, shift-drag moves, wheel zooms';
    document.body.dataset.drawn = String(corners.length / 3);
  };
  let held = null;
  canvas.addEventListener('pointerdown', (e) => {
    held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener('pointerup', () => { held = null; });
  canvas.addEventListener('pointermove', (e) => {
    if (!held) return;
    const dx = e.clientX - held[0], dy = e.clientY - held[1]; held = [e.clientX, e.clientY];
    if (e.shiftKey) {
      shift[0] += dx * far / 700; shift[1] -= dy * far / 700;
    } else {
      turn -= dx / 150; tilt = Math.max(-1.57, Math.min(1.57, tilt + dy / 150));
    }
    draw();
  });
  canvas.addEventListener('wheel', (e) => {
    e.preventDefault(); far *= Math.exp(e.deltaY / 800); draw();
  }, { passive: false });
  document.getElementById('plain').addEventListener('change', (e) => {
    plain = e.target.checked ? 1 : 0; draw();
  });
  window.addEventListener('resize', draw);
  draw();
})();
""".replace('@MAP@', glsl())
