// Copy buttons and enlarged pictures; without scripts the page says the same.
"use strict";
(function () {
  for (const button of document.querySelectorAll("button.copy")) {
    if (!navigator.clipboard) continue;
    button.hidden = false;
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText(button.parentElement.querySelector("pre").textContent);
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    });
  }
  const place = document.getElementById("bundle-place");
  if (place && location.protocol === "file:") {
    const bundle = decodeURIComponent(new URL("..", location.href).pathname).replace(/\/$/, "");
    const name = document.querySelector("h1").textContent;
    for (const lines of document.querySelectorAll(".load pre")) {
      lines.textContent = lines.textContent.replaceAll(`build/${name}/`, `${bundle}/`);
    }
    place.textContent = "Absolute paths to this bundle.";
  }
  const dialog = document.getElementById("large");
  const shown = dialog.querySelector("img");
  for (const button of document.querySelectorAll("button.zoom")) {
    button.addEventListener("click", () => {
      const image = button.querySelector("img");
      shown.src = image.src;
      shown.alt = image.alt;
      dialog.showModal();
    });
  }
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog || event.target.closest(".close") || event.target === shown) dialog.close();
  });
})();
