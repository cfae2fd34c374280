// Small marks in the text of a page, which take no space and are found again on its printed pages, with where they are.
(() => {
  let group = 0;
  const style = "font: 3px sans-serif; letter-spacing: 0; white-space: nowrap;";
  const mark = (kind) => {
    const place = document.createElement("span");
    const text = document.createElement("span");
    place.style.cssText = "position: relative; display: inline-block; width: 0;";
    text.style.cssText = `${style} position: absolute; right: 0; bottom: 0;`;
    text.textContent = `@${kind}${group}@`;
    place.append(text);
    return place;
  };
  const markDrawing = (svg, kind, x, y) => {
    const text = document.createElementNS("http://www.w3.org/2000/svg", "text");
    text.setAttribute("style", `${style} text-anchor: start;`);
    text.setAttribute("x", String(x));
    text.setAttribute("y", String(y));
    text.textContent = `@${kind}${group}@`;
    svg.append(text);
  };
  for (const row of document.querySelectorAll("tbody tr")) {
    group += 1;
    for (const cell of row.cells) { cell.prepend(mark("R")); cell.append(mark("R")); }
  }
  for (const figure of document.querySelectorAll("figure")) {
    group += 1;
    const svg = figure.querySelector("svg");
    markDrawing(svg, "P", 60, 6); markDrawing(svg, "P", 60, svg.viewBox.baseVal.height - 3);
    figure.querySelector("figcaption").append(mark("P"));
  }
  const skipped = "script, style, nav, .how, #reading";
  for (const heading of document.querySelectorAll("h1, h2, h3")) {
    group += 1;
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    texts.currentNode = heading.lastChild;
    let next = texts.nextNode();
    while (next !== null && (heading.contains(next) || next.parentElement.closest(skipped) || !next.textContent.trim())) {
      next = texts.nextNode();
    }
    const drawing = next.parentElement.closest("svg.chart, svg.bars");
    if (drawing === null) next.before(mark("H")); else markDrawing(drawing, "H", 200, 6);
    heading.append(mark("H"));
  }
})();
