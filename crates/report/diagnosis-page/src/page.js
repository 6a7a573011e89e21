// one instant in the plots over time is one place on the road: both point at it
const places = (drive) => [...document.querySelectorAll(`.maps[data-drive="${drive}"] svg`)].map((svg) => ({
  here: svg.querySelector(".here"),
  segments: [...svg.querySelectorAll("[data-t]")].map((line) => ({ secs: Number(line.dataset.t), at: line.points[0] })),
}));
for (const plot of document.querySelectorAll(".time")) {
  const [from, to, left, right] = ["from", "to", "left", "right"].map((key) => Number(plot.dataset[key]));
  const svg = plot.querySelector("svg"), cursor = plot.querySelector(".cursor"), maps = places(plot.dataset.drive);
  const point = (secs) => {
    const inside = secs >= from && secs <= to;
    cursor.style.visibility = inside ? "visible" : "hidden";
    const x = left + (right - left) * (secs - from) / (to - from);
    if (inside) for (const end of ["x1", "x2"]) cursor.setAttribute(end, x);
    for (const { here, segments } of maps) {
      const nearest = segments.reduce((a, b) => Math.abs(b.secs - secs) < Math.abs(a.secs - secs) ? b : a, segments[0]);
      here.style.visibility = inside && nearest ? "visible" : "hidden";
      if (inside && nearest) { here.setAttribute("cx", nearest.at.x); here.setAttribute("cy", nearest.at.y); }
    }
  };
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const x = (event.clientX - box.left) * svg.viewBox.baseVal.width / box.width;
    point(from + (to - from) * (x - left) / (right - left));
  });
  svg.addEventListener("pointerleave", () => point(NaN));
  for (const map of document.querySelectorAll(`.maps[data-drive="${plot.dataset.drive}"]`)) {
    map.addEventListener("pointerover", (event) => { if (event.target.dataset.t) point(Number(event.target.dataset.t)); });
    map.addEventListener("pointerleave", () => point(NaN));
  }
}
