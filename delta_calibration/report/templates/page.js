"use strict";
// Draws each panel when it comes near the screen, all of them before the page is printed.
(() => {
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const config = {
    responsive: false, displaylogo: false, showLink: false, scrollZoom: false,
    displayModeBar: false, doubleClick: "reset",
  };
  const drawn = new Map();
  const LINE = 15; // pixels
  const SPARE = 1.1; // times the height: ranges of axes are a little wider than what is drawn

  const draw = (id, width) => {
    const place = document.getElementById(id);
    const plot = plots[id];
    const layout = structuredClone(plot.layout); // Plotly writes into what it is given
    layout.width = Math.floor(width || place.clientWidth);
    drawn.set(id, layout.width);
    return Plotly.react(place, plot.data, layout, config).then(() => fit(place, plot));
  };

  // A panel of one scale is no higher than what is drawn in it, once names have taken their width.
  const fit = (place, plot) => {
    const shape = plot.layout.meta?.shape;
    if (!shape) return undefined;
    const {w, h} = place._fullLayout._size;
    const height = Math.ceil(plot.layout.height - h + SPARE * w * shape);
    if (height >= plot.layout.height) return undefined;
    place.style.minHeight = `${height}px`;
    return Plotly.relayout(place, {height, ...fewer(plot.layout.yaxis, w * shape)});
  };

  const ids = Object.keys(plots);
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting && !drawn.has(entry.target.id)) draw(entry.target.id);
    }
  }, {rootMargin: "1200px"});
  for (const id of ids) {
    const place = document.getElementById(id);
    place.style.minHeight = `${plots[id].layout.height}px`;
    seen.observe(place);
  }

  // As many names along y as lines of text that the height has.
  const fewer = ({tickvals, ticktext}, high) => {
    const step = Math.ceil(LINE * ticktext.length / high);
    const some = (all) => all.filter((_, k) => k % step === 0);
    return {"yaxis.tickvals": some(tickvals), "yaxis.ticktext": some(ticktext)};
  };

  let waiting = 0;
  window.addEventListener("resize", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      for (const id of drawn.keys()) {
        const place = document.getElementById(id);
        if (Math.floor(place.clientWidth) !== drawn.get(id)) draw(id);
      }
    }, 150);
  });

  window.addEventListener("beforeprint", () => {
    document.body.classList.add("printing");
    for (const id of ids) draw(id);
  });
  window.addEventListener("afterprint", () => {
    document.body.classList.remove("printing");
    for (const id of ids) draw(id);
  });
})();
