(() => {
  const quoted = (text) => "'" + text.replaceAll("'", "'\\''") + "'";
  const says = document.getElementById("says");
  const manifest = document.getElementById("command").dataset.manifest;
  const cards = [...document.querySelectorAll(".card")];
  const tell = () => {
    const words = { accept: [], reject: [] };
    for (const card of cards) {
      const chosen = card.querySelector("input[type=radio]:checked");
      const name = card.dataset.name;
      const reason = card.querySelector("input[type=text]").value.trim();
      if (chosen && chosen.value === "accept") words.accept.push(quoted(name));
      if (chosen && chosen.value === "reject") words.reject.push(quoted(name + "=" + (reason || "REASON")));
    }
    const told = ["dreamstream benchmark review " + quoted(manifest)];
    for (const [verdict, names] of Object.entries(words)) {
      if (names.length) told.push("--" + verdict + " " + names.join(" "));
    }
    says.textContent = told.join(" \\\n    ");
  };
  document.addEventListener("input", tell);
})();
