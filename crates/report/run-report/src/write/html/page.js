for (const input of document.querySelectorAll(".filter input")) {
  input.parentElement.hidden = false;
  const rows = [...document.getElementById(input.dataset.table).querySelectorAll("tbody tr")];
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
  });
}
