// The map of a city: streets, buildings, cameras and the ground they see, on a sheet of canvas larger
// than its frame. A pan only moves the sheet, a zoom stretches it. When the hand rests or the frame
// would leave it, a spare one is drawn, a few thousand corners a frame, and then takes its place.
// What is smaller than a pixel is not drawn.
"use strict";
(() => {
  const SPARE = 0.35, REST_MS = 90, NEAR_PX = 12, CAMERA_M = 7, MOST = 8000;

  function bytes(text) {
    return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  }

  // Lines of corners in metres from the city's origin, and the box round each.
  function unpack({ counts, steps, far }, unit) {
    const count = new Uint32Array(bytes(counts)), step = new Int16Array(bytes(steps));
    const first = new Uint32Array(count.length + 1), box = new Float64Array(4 * count.length);
    const at = new Float64Array(step.length);
    const jump = new Map(far.map(([i, x, y]) => [i, [x, y]]));
    let x = 0, y = 0;
    for (let i = 0; i < step.length / 2; i++) {
      x += step[2 * i];
      y += step[2 * i + 1];
      if (jump.has(i)) [x, y] = jump.get(i);
      at[2 * i] = x * unit;
      at[2 * i + 1] = y * unit;
    }
    for (let n = 0; n < count.length; n++) {
      first[n + 1] = first[n] + count[n];
      const b = [Infinity, Infinity, -Infinity, -Infinity];
      for (let i = first[n]; i < first[n + 1]; i++) {
        b[0] = Math.min(b[0], at[2 * i]);
        b[1] = Math.min(b[1], at[2 * i + 1]);
        b[2] = Math.max(b[2], at[2 * i]);
        b[3] = Math.max(b[3], at[2 * i + 1]);
      }
      box.set(b, 4 * n);
    }
    return { first, at, box, size: count.length };
  }

  function start(frame, city) {
    let [sheet, spare] = frame.querySelectorAll("canvas");
    const marks = frame.querySelector(".marks");
    const note = frame.querySelector(".note"), bar = frame.querySelector(".bar");
    const layers = city.layers.map((layer) => ({ ...layer, ...unpack(layer.lines, city.unit) }));
    const cameras = city.cameras, grounds = layers.find((layer) => layer.owner);
    const whole = city.box;
    // The view: metres in the frame's middle, pixels a metre; `drawn` is the sheet's own.
    let view = null, drawn = null, resting = 0, pointed = -1, drawing = 0, busy = -1;

    const width = () => frame.clientWidth, height = () => frame.clientHeight;
    const fit = () => {
      const scale = 0.96 * Math.min(width() / (whole[2] - whole[0]), height() / (whole[3] - whole[1]));
      return { x: (whole[0] + whole[2]) / 2, y: (whole[1] + whole[3]) / 2, scale };
    };
    const place = (px, py) => [
      view.x + (px - width() / 2) / view.scale, view.y - (py - height() / 2) / view.scale,
    ];

    // Trace lines n … of a layer as far as `MOST` corners go, those that `window` meets; corners
    // nearer than a pixel are left out. Return the next n.
    function trace(pen, layer, n, window, scale) {
      const { first, at, box, fill } = layer, near = 0.8 / scale;
      const least = fill ? 1.2 / scale : 0;
      let corners = 0;
      pen.beginPath();
      for (; n < layer.size && corners < MOST; n++) {
        const b = 4 * n;
        if (box[b] > window[2] || box[b + 1] > window[3]) continue;
        if (box[b + 2] < window[0] || box[b + 3] < window[1]) continue;
        if (box[b + 2] - box[b] < least && box[b + 3] - box[b + 1] < least) continue;
        const end = first[n + 1] - 1;
        let x = at[2 * first[n]], y = at[2 * first[n] + 1];
        pen.moveTo(x, y);
        for (let i = first[n] + 1; i <= end; i++) {
          const u = at[2 * i], v = at[2 * i + 1];
          if (i < end && Math.abs(u - x) < near && Math.abs(v - y) < near) continue;
          pen.lineTo(u, v);
          corners++;
          x = u;
          y = v;
        }
        if (fill) pen.closePath();
      }
      return n;
    }

    // Draw a sheet for `seen`, a little at a time.
    function* paint(canvas, seen) {
      const ratio = window.devicePixelRatio || 1, w = width(), h = height();
      const [sw, sh] = [w * (1 + 2 * SPARE), h * (1 + 2 * SPARE)].map((s) => Math.round(s * ratio));
      if (canvas.width !== sw || canvas.height !== sh) [canvas.width, canvas.height] = [sw, sh];
      canvas.style.width = `${sw / ratio}px`;
      canvas.style.height = `${sh / ratio}px`;
      canvas.style.left = `${-w * SPARE}px`;
      canvas.style.top = `${-h * SPARE}px`;
      const pen = canvas.getContext("2d", { alpha: false }), scale = seen.scale, k = scale * ratio;
      pen.setTransform(1, 0, 0, 1, 0, 0);
      pen.fillStyle = "#fff";
      pen.fillRect(0, 0, sw, sh);
      pen.setTransform(k, 0, 0, -k, sw / 2 - seen.x * k, sh / 2 + seen.y * k);
      const half = [sw / 2 / k, sh / 2 / k];
      const reach = [seen.x - half[0], seen.y - half[1], seen.x + half[0], seen.y + half[1]];
      pen.lineJoin = "round";
      for (const layer of layers) {
        for (let n = 0; n < layer.size;) {
          n = trace(pen, layer, n, reach, scale);
          if (layer.fill) {
            pen.fillStyle = layer.fill;
            pen.globalAlpha = layer.alpha;
            pen.fill("nonzero");
            pen.globalAlpha = 1;
          } else {
            pen.strokeStyle = layer.stroke;
            pen.lineWidth = Math.max(layer.width, layer.least / scale);
            pen.stroke();
          }
          yield;
        }
      }
      const r = Math.min(6, Math.max(1.8, 2.2 * scale ** 0.5)) / scale, long = CAMERA_M * scale > 8;
      pen.fillStyle = pen.strokeStyle = city.camera;
      pen.lineWidth = 1.6 / scale;
      pen.beginPath();
      for (const [x, y, yaw] of cameras) {
        if (x < reach[0] || x > reach[2] || y < reach[1] || y > reach[3]) continue;
        pen.moveTo(x + r, y);
        pen.arc(x, y, r, 0, 2 * Math.PI);
        if (long) {
          pen.moveTo(x, y);
          pen.lineTo(x + CAMERA_M * Math.cos(yaw), y + CAMERA_M * Math.sin(yaw));
        }
      }
      pen.fill();
      if (long) pen.stroke();
    }

    // Put the spare sheet, which is drawn, in the other's place.
    function turn(seen) {
      [sheet, spare] = [spare, sheet];
      drawn = seen;
      lay();
      sheet.style.visibility = "visible";
      spare.style.visibility = "hidden";
      frame.dataset.drawn = String(Number(frame.dataset.drawn || 0) + 1);
    }

    // Draw now, or over as many frames as it takes; whoever asks meanwhile is served after that.
    function draw(now) {
      if (now) {
        const seen = { ...view };
        drawing++;
        for (const _ of paint(spare, seen));
        return turn(seen);
      }
      if (busy === drawing) return;
      busy = ++drawing;
      const mine = busy, seen = { ...view }, job = paint(spare, seen);
      const go = () => {
        if (mine !== drawing) return;
        if (!job.next().done) return void requestAnimationFrame(go);
        busy = -1;
        turn(seen);
        show();
      };
      go();
    }

    // Lay the sheet, drawn for another view, where this view has it.
    function lay() {
      const grown = view.scale / drawn.scale;
      const dx = (drawn.x - view.x) * view.scale, dy = (view.y - drawn.y) * view.scale;
      sheet.style.transform = `translate(${dx}px, ${dy}px) scale(${grown})`;
      const ox = SPARE * width() * grown + (grown - 1) * width() / 2;
      const oy = SPARE * height() * grown + (grown - 1) * height() / 2;
      return Math.abs(dx) <= ox && Math.abs(dy) <= oy;
    }

    function show(now = false) {
      clearTimeout(resting);
      const covered = drawn && lay();
      if (now || !drawn || (!covered && view.scale === drawn.scale)) {
        draw(now || !drawn);
      } else if (view.x !== drawn.x || view.y !== drawn.y || view.scale !== drawn.scale) {
        resting = setTimeout(() => draw(false), REST_MS);
      }
      mark();
      measure();
    }

    // The ground of the camera that is pointed at, and a ring round it.
    function mark() {
      const ratio = window.devicePixelRatio || 1, w = Math.round(width() * ratio);
      const h = Math.round(height() * ratio), k = view.scale * ratio;
      if (marks.width !== w || marks.height !== h) [marks.width, marks.height] = [w, h];
      const pen = marks.getContext("2d");
      pen.setTransform(1, 0, 0, 1, 0, 0);
      if (marks.dataset.used) pen.clearRect(0, 0, w, h);
      marks.dataset.used = pointed < 0 ? "" : "yes";
      if (pointed < 0) return;
      pen.setTransform(k, 0, 0, -k, w / 2 - view.x * k, h / 2 + view.y * k);
      pen.beginPath();
      for (let n = 0; n < grounds.size; n++) {
        if (grounds.owner[n] !== pointed) continue;
        for (let i = grounds.first[n]; i < grounds.first[n + 1]; i++) {
          pen[i === grounds.first[n] ? "moveTo" : "lineTo"](grounds.at[2 * i], grounds.at[2 * i + 1]);
        }
        pen.closePath();
      }
      pen.fillStyle = grounds.fill;
      pen.globalAlpha = 0.55;
      pen.fill("evenodd");
      pen.globalAlpha = 1;
      pen.strokeStyle = "#000";
      pen.lineWidth = 1.2 / view.scale;
      pen.stroke();
      const [x, y] = cameras[pointed];
      pen.beginPath();
      pen.arc(x, y, 9 / view.scale, 0, 2 * Math.PI);
      pen.lineWidth = 2 / view.scale;
      pen.stroke();
    }

    function measure() {
      const most = 160 / view.scale, power = 10 ** Math.floor(Math.log10(most));
      const length = power * (most / power >= 5 ? 5 : most / power >= 2 ? 2 : 1);
      bar.style.width = `${length * view.scale}px`;
      bar.textContent = length >= 1000 ? `${length / 1000} km` : `${Number(length.toPrecision(1))} m`;
    }

    function point(index) {
      if (index === pointed) return;
      pointed = index;
      note.textContent = index < 0 ? "" : city.texts[index];
      mark();
    }

    function nearest(px, py) {
      const [x, y] = place(px, py);
      let best = NEAR_PX / view.scale, found = -1;
      cameras.forEach(([u, v], n) => {
        const d = Math.hypot(u - x, v - y);
        if (d < best) [best, found] = [d, n];
      });
      return found;
    }

    const smallest = () => 0.5 * fit().scale;
    function zoom(factor, px = width() / 2, py = height() / 2) {
      const [x, y] = place(px, py);
      view.scale = Math.min(60, Math.max(smallest(), view.scale * factor));
      view.x = x - (px - width() / 2) / view.scale;
      view.y = y + (py - height() / 2) / view.scale;
      show();
    }
    function pan(dx, dy) {
      view.x -= dx / view.scale;
      view.y += dy / view.scale;
      show();
    }
    function visit(index) {
      const [x, y] = cameras[index];
      view = { x, y, scale: Math.max(view.scale, 4) };
      show(true);
      point(index);
    }
    function all() {
      view = fit();
      show(true);
    }

    const hands = new Map();
    const at = (event) => {
      const box = frame.getBoundingClientRect();
      return [event.clientX - box.left - frame.clientLeft, event.clientY - box.top - frame.clientTop];
    };
    frame.addEventListener("pointerdown", (event) => {
      if (event.target.closest("button")) return;
      frame.setPointerCapture(event.pointerId);
      hands.set(event.pointerId, at(event));
    });
    frame.addEventListener("pointermove", (event) => {
      const here = at(event), before = hands.get(event.pointerId);
      if (!before) return void point(nearest(...here));
      const others = [...hands].filter(([id]) => id !== event.pointerId).map(([, spot]) => spot);
      hands.set(event.pointerId, here);
      if (!others.length) return void pan(here[0] - before[0], here[1] - before[1]);
      const [other] = others, apart = (spot) => Math.hypot(spot[0] - other[0], spot[1] - other[1]);
      zoom(apart(here) / Math.max(apart(before), 1), ...other);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      frame.addEventListener(end, (event) => hands.delete(event.pointerId));
    }
    frame.addEventListener("pointerleave", () => point(-1));
    frame.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(Math.exp(-0.0015 * event.deltaY * (event.deltaMode ? 20 : 1)), ...at(event));
    }, { passive: false });
    frame.addEventListener("keydown", (event) => {
      const step = 0.15 * Math.min(width(), height());
      const does = {
        ArrowLeft: () => pan(step, 0), ArrowRight: () => pan(-step, 0),
        ArrowUp: () => pan(0, step), ArrowDown: () => pan(0, -step),
        "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), Home: all,
      }[event.key];
      if (!does) return;
      event.preventDefault();
      does();
    });
    const buttons = { in: () => zoom(1.5), out: () => zoom(1 / 1.5), all };
    frame.querySelectorAll("button").forEach((button) =>
      button.addEventListener("click", buttons[button.dataset.does]));
    document.querySelectorAll("tr[data-camera]").forEach((row) => {
      const index = Number(row.dataset.camera);
      row.addEventListener("click", () => visit(index));
      row.addEventListener("keydown", (event) => { if (event.key === "Enter") visit(index); });
    });
    new ResizeObserver(() => {
      if (!view) all();
      else show(true);
    }).observe(frame);
    all();
    frame.mapView = () => ({ ...view, pointed });
    document.body.dataset.ready = "yes";
  }

  document.addEventListener("DOMContentLoaded", () => {
    const data = document.getElementById("city");
    if (data) start(document.getElementById("map"), JSON.parse(data.textContent));
  });
})();
