"use strict";
// rows of a sortable table go by a heading that is clicked: numbers fall first, texts rise first, a third click restores
for (const table of document.querySelectorAll("table.sortable")) {
  const headings = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  const original = [...body.rows];
  headings.forEach((heading, index) => heading.firstElementChild.addEventListener("click", () => {
    const numeric = heading.classList.contains("n");
    const first = numeric ? "descending" : "ascending", second = numeric ? "ascending" : "descending";
    const before = heading.getAttribute("aria-sort");
    const order = before === null ? first : before === first ? second : null;
    headings.forEach((other) => other.removeAttribute("aria-sort"));
    const sign = order === "descending" ? -1 : 1;
    const rows = [...original];
    if (order !== null) {
      heading.setAttribute("aria-sort", order);
      rows.sort((a, b) => {
        const [x, y] = [a, b].map((row) => row.cells[index]);
        if (!numeric) return sign * x.textContent.localeCompare(y.textContent, undefined, { numeric: true });
        const [p, q] = [x, y].map((cell) => cell.dataset.sort ? Number(cell.dataset.sort) : NaN);
        if (Number.isNaN(p) || Number.isNaN(q)) return Number.isNaN(p) - Number.isNaN(q);
        return sign * (p - q);
      });
    }
    body.append(...rows);
  }));
}
