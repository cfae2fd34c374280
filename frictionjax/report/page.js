// Charts: the values under the pointer, and zoom by dragging along the axis. The page is complete without this script.
"use strict";
(() => {
  const reading = document.getElementById("reading");
  const namespace = "http://www.w3.org/2000/svg";

  function round(value) {
    if (!Number.isFinite(value)) return "–";
    const text = Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-3)
      ? value.toExponential(2) : String(Number(value.toPrecision(4)));
    return text.replace(/-/g, "−");
  }

  // Absolute points of path data: "M x y l dx dy dx dy ..." and dots "M x y h0".
  function points(data) {
    const found = [];
    for (const part of data.split("M").slice(1)) {
      const numbers = part.replace("h0", "").replace("z", "").split(/[l\s]+/).filter(Boolean).map(Number);
      let [x, y] = numbers;
      found.push([x, y]);
      if (part.includes("l")) {
        for (let k = 2; k + 1 < numbers.length; k += 2) {
          x += numbers[k]; y += numbers[k + 1];
          found.push([x, y]);
        }
      }
    }
    return found;
  }

  function marks(low, high, most) {
    const raw = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 2.5, 5, 10, 20].find((size) => size * power >= raw * (1 - 1e-9));
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
    return found;
  }

  function chart(svg) {
    const own = svg.dataset;
    const [low, high, left, inner] = [own.low, own.high, own.left, own.inner].map(Number);
    const [columns, rows] = [own.columns, own.rows].map(Number);
    const panels = [...svg.querySelectorAll(".panel")].map((group) => ({
      group, plot: group.querySelector(".plot"), top: Number(group.dataset.top), height: Number(group.dataset.height),
      low: Number(group.dataset.low), high: Number(group.dataset.high), unit: group.dataset.unit,
      series: [...group.querySelectorAll("path[data-label]")].map((path) => (
        {label: path.dataset.label, css: path.classList[0], area: path.classList.contains("area"),
          points: points(path.getAttribute("d"))}
      )),
      view: [0, rows],
    }));
    const ruler = document.createElementNS(namespace, "line");
    const chosen = document.createElementNS(namespace, "rect");
    ruler.classList.add("ruler"); chosen.classList.add("chosen");
    svg.append(ruler, chosen);
    const foot = panels[panels.length - 1].top + panels[panels.length - 1].height;
    let view = [0, columns];
    let start = null;

    const value = (column) => {
      const along = low + (high - low) * column / columns;
      return own.log ? 10 ** along : along;
    };
    const upwards = (panel, row) => panel.high - (panel.high - panel.low) * row / rows;

    function place(event) {
      const box = svg.getBoundingClientRect();
      const scale = svg.viewBox.baseVal.width / box.width;
      const x = (event.clientX - box.left) * scale;
      const share = Math.min(Math.max((x - left) / inner, 0), 1);
      return {x: left + share * inner, y: (event.clientY - box.top) * scale, column: view[0] + share * (view[1] - view[0])};
    }

    function ticks(group, words, at, horizontal) {
      group.replaceChildren();
      words.forEach(([where, word]) => {
        const line = document.createElementNS(namespace, "line");
        const text = document.createElementNS(namespace, "text");
        const ends = horizontal ? {x1: where, x2: where, y1: foot, y2: foot + 4}
          : {x1: left, x2: left + inner, y1: where, y2: where};
        for (const [name, number] of Object.entries(ends)) line.setAttribute(name, number);
        text.setAttribute("x", horizontal ? where : left - 5);
        text.setAttribute("y", horizontal ? foot + 16 : where + 4);
        text.textContent = word;
        group.append(line, text);
      });
    }

    function draw() {
      const along = svg.querySelector(".ticks.x");
      const ends = view.map((column) => low + (high - low) * column / columns);
      let places = marks(ends[0], ends[1], 6);
      if (own.log && ends[1] - ends[0] >= 1) places = places.filter((at) => Number.isInteger(at));
      ticks(along, places.map((at) => [
        left + inner * (at - ends[0]) / (ends[1] - ends[0]), round(own.log ? 10 ** at : Number(at.toPrecision(12))),
      ]), 0, true);
      for (const panel of panels) {
        const [top, bottom] = panel.view;
        panel.plot.setAttribute("viewBox", `${view[0]} ${top} ${view[1] - view[0]} ${bottom - top}`);
        const [floor, ceiling] = [upwards(panel, bottom), upwards(panel, top)];
        ticks(panel.group.querySelector(".ticks.y"), marks(floor, ceiling, panel.height > 100 ? 5 : 3).map((at) => [
          panel.top + panel.height * (ceiling - at) / (ceiling - floor), round(Number(at.toPrecision(12))),
        ]), 0, false);
      }
    }

    // The rows that the lines between two columns take, with a margin.
    function rise(panel, first, last) {
      let [top, bottom] = [Infinity, -Infinity];
      for (const one of panel.series) {
        if (one.area) continue;
        for (const [x, y] of one.points) {
          if (x >= first && x <= last) { top = Math.min(top, y); bottom = Math.max(bottom, y); }
        }
      }
      if (!(bottom > top)) return [0, rows];
      const margin = 0.06 * (bottom - top);
      return [Math.max(top - margin, -rows), Math.min(bottom + margin, 2 * rows)];
    }

    function zoom(first, last) {
      view = [first, last];
      const whole = first === 0 && last === columns;
      for (const panel of panels) panel.view = whole ? [0, rows] : rise(panel, first, last);
      draw();
    }

    function nearest(panel, series, at) {
      const row = panel.view[0] + (at.y - panel.top) / panel.height * (panel.view[1] - panel.view[0]);
      let [best, found] = [Infinity, null];
      for (const [x, y] of series.points) {
        const across = (x - at.column) / columns;
        const distance = own.path ? across * across + ((y - row) / rows) ** 2 : Math.abs(across);
        if (distance < best) { best = distance; found = [x, y]; }
      }
      return found;
    }

    function read(event) {
      const at = place(event);
      const lines = [`${own.name} ${round(value(at.column))} ${own.unit}`];
      for (const panel of panels) {
        for (const series of panel.series) {
          const found = series.area ? null : nearest(panel, series, at);
          if (found) lines.push(`${series.label}: ${round(upwards(panel, found[1]))} ${panel.unit}`);
        }
      }
      for (const [name, number] of Object.entries({x1: at.x, x2: at.x, y1: panels[0].top, y2: foot})) ruler.setAttribute(name, number);
      reading.replaceChildren(...lines.map((line) => Object.assign(document.createElement("div"), {textContent: line})));
      reading.hidden = false;
      const width = reading.offsetWidth;
      reading.style.left = `${Math.max(4, Math.min(event.clientX + 14, document.documentElement.clientWidth - width - 4))}px`;
      reading.style.top = `${Math.max(4, event.clientY - reading.offsetHeight - 12)}px`;
      ruler.style.display = "block";
      if (start !== null) {
        const [first, last] = [start.x, at.x].sort((a, b) => a - b);
        for (const [name, number] of Object.entries({x: first, width: last - first, y: panels[0].top, height: foot - panels[0].top})) chosen.setAttribute(name, number);
        chosen.style.display = "block";
      }
    }

    function leave() {
      reading.hidden = true; start = null;
      ruler.style.display = chosen.style.display = "none";
    }

    svg.classList.add("live");
    svg.addEventListener("pointermove", read);
    svg.addEventListener("pointerleave", leave);
    svg.addEventListener("pointerdown", (event) => { if (event.pointerType === "mouse" && event.button === 0) { start = place(event); event.preventDefault(); } });
    svg.addEventListener("pointerup", (event) => {
      if (start === null) return;
      const [first, last] = [start.column, place(event).column].sort((a, b) => a - b);
      start = null; chosen.style.display = "none";
      if (last - first > 0.01 * (view[1] - view[0])) zoom(first, last);
    });
    svg.addEventListener("dblclick", () => zoom(0, columns));
    svg.append(Object.assign(document.createElementNS(namespace, "title"), {textContent: "Drag to zoom, double-click for the whole"}));
  }

  document.querySelectorAll("svg.chart").forEach(chart);
  document.querySelectorAll(".how").forEach((words) => { words.hidden = false; });
})();
