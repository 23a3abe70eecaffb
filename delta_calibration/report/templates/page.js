"use strict";
// Draws each panel when it comes near the screen, all of them before the page is printed.
(() => {
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const config = {
    responsive: false, displaylogo: false, showLink: false, scrollZoom: false,
    displayModeBar: false, doubleClick: "reset",
  };
  const drawn = new Map();

  const draw = (id, width) => {
    const place = document.getElementById(id);
    const plot = plots[id];
    const layout = {...plot.layout, width: Math.floor(width || place.clientWidth)};
    drawn.set(id, layout.width);
    return Plotly.react(place, plot.data, layout, config);
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
