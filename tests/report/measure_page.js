// What a browser shows of the report, measured, and sent to the page that frames it.
(() => {
  const errors = [];
  addEventListener("error", (event) => errors.push(event.message));
  const wide = document.documentElement.clientWidth;
  const name = (element) => `${element.tagName} ${element.className.baseVal ?? element.className} ${element.textContent.slice(0, 40)}`;
  const all = [...document.body.querySelectorAll("*")].filter((element) => element.id !== "reading" && !element.closest("#reading"));
  const overflowing = all.filter((element) => {
    const box = element.getBoundingClientRect();
    return !element.closest("svg svg, .gauge") && box.width > 1 && (box.right > wide + 1 || box.left < -1);
  }).map(name);
  const cut = all.filter((element) => !element.closest("svg") && element.scrollWidth > element.clientWidth + 1
    && element.clientWidth > 1 && getComputedStyle(element).display !== "inline").map(name);
  const texts = [...document.querySelectorAll("svg.chart text, svg.bars text")].map((text) => {
    const svg = text.ownerSVGElement;
    return 12.5 * svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
  });
  // A number of the extended model stands beside or below that of the base model, never in the column of the headings.
  const torn = [...document.querySelectorAll("td span.to")].filter((arrow) => (
    arrow.getBoundingClientRect().left < arrow.previousElementSibling.getBoundingClientRect().left - 1
  )).map((arrow) => name(arrow.parentElement));
  const chart = [...document.querySelectorAll("svg.chart")].find((svg) => svg.dataset.name === "time");
  const box = chart.getBoundingClientRect();
  const at = (share, kind) => chart.dispatchEvent(new PointerEvent(kind, {
    bubbles: true, pointerType: "mouse", button: 0, clientX: box.left + share * box.width, clientY: box.top + 0.2 * box.height,
  }));
  const ticks = () => [...chart.querySelectorAll(".ticks.x text")].map((text) => text.textContent);
  const before = ticks();
  at(0.5, "pointermove");
  const reading = [...document.getElementById("reading").children].map((line) => line.textContent);
  at(0.3, "pointerdown"); at(0.5, "pointermove"); at(0.5, "pointerup");
  const zoomed = ticks();
  chart.dispatchEvent(new MouseEvent("dblclick"));
  const found = {
    width: innerWidth, errors, overflowing, cut, torn, smallest_text: Math.min(...texts), reading,
    ticks_before: before.map(Number), ticks_zoomed: zoomed.map(Number), ticks_after: ticks().map(Number),
  };
  parent.postMessage(JSON.stringify(found), "*");
})();
