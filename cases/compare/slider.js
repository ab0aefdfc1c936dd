"use strict";
// Lays two pictures of a view over each other: what is left of a line is of one state, what is right of it of another.
(() => {
  for (const figure of document.querySelectorAll("figure.compared")) {
    const over = figure.querySelector(".over"), images = [...over.querySelectorAll("img")];
    const [left, right] = figure.querySelectorAll("select"), range = figure.querySelector("input");
    const tags = [...over.querySelectorAll(".tag")];

    function show() {
      images.forEach((image, i) => {
        image.classList.toggle("right", i === right.selectedIndex && right.selectedIndex !== left.selectedIndex);
        image.hidden = i !== left.selectedIndex && i !== right.selectedIndex;
      });
      over.style.setProperty("--at", range.value + "%");
      const words = range.value + " % " + left.value + ", then " + right.value;
      range.setAttribute("aria-valuetext", words);
      tags.forEach((tag, i) => {
        tag.hidden = false;
        tag.textContent = [left, right][i].value;
      });
    }

    for (const control of [left, right, range]) control.addEventListener("input", show);
    figure.querySelector(".over-controls").hidden = false;
    show();
  }
})();
