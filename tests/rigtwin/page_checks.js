// What the tests ask a page in the browser; every function returns what is wrong, as words.
({
  // Texts that are harder to read than 4.5 : 1 (WCAG 2.2, 1.4.3), on the ground behind them.
  contrast() {
    const channel = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    const canvas = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
    const rgba = colour => {
      canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
      return [...canvas.getImageData(0, 0, 1, 1).data];
    };
    const luminance = c => [0.2126, 0.7152, 0.0722].reduce((sum, w, n) => sum + w * channel(c[n] / 255), 0);
    const ground = element => {
      for (let at = element; at; at = at.parentElement) {
        const c = rgba(getComputedStyle(at).backgroundColor);
        if (c[3] === 255) return c;
      }
      const bare = document.body.appendChild(document.createElement("i"));
      bare.style.background = "Canvas";
      const canvasColour = getComputedStyle(bare).backgroundColor;
      bare.remove();
      return rgba(canvasColour);
    };
    const wrong = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const element = walker.currentNode.parentElement;
      if (!walker.currentNode.data.trim() || element.closest("script, style, #gap-map .scatterlayer")) continue;
      if (!element.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue;
      const style = getComputedStyle(element), inDrawing = element.closest("svg");
      const [a, b] = [rgba(inDrawing ? style.fill : style.color), ground(element)].map(luminance).sort((x, y) => y - x);
      const ratio = (a + 0.05) / (b + 0.05);
      if (ratio < 4.5) wrong.push(`${ratio.toFixed(2)}: ${walker.currentNode.data.trim().slice(0, 40)}`);
    }
    return wrong;
  },

  // What reaches over the right edge of the page, unless it scrolls in its own box; and texts cut by their drawing.
  cut() {
    const wrong = [], width = document.documentElement.clientWidth;
    if (document.documentElement.scrollWidth > width) wrong.push(`the page is ${document.documentElement.scrollWidth} wide`);
    for (const element of document.body.querySelectorAll("*")) {
      const box = element.getBoundingClientRect();
      if (!box.width || element.closest(".table, .wide, pre, select, #js-plotly-tester")) continue;
      if (box.right > width + 1) wrong.push(`${element.tagName} ${element.className} ends at ${box.right.toFixed(0)}`);
    }
    for (const text of document.querySelectorAll(".figure text")) {
      const frame = text.closest(".figure").getBoundingClientRect(), box = text.getBoundingClientRect();
      const out = Math.max(frame.left - box.left, box.right - frame.right, frame.top - box.top, box.bottom - frame.bottom);
      if (box.width && out > 1.5) wrong.push(`${text.closest(".figure").id}: "${text.textContent}" is cut by ${out.toFixed(0)} px`);
    }
    return wrong;
  },

  // Boxes that scroll, and those among them that the keyboard does not reach.
  unreachable() {
    const boxes = [...document.querySelectorAll(".table, .wide, pre")].filter(box => box.scrollWidth > box.clientWidth + 1);
    return boxes.filter(box => box.tabIndex < 0).map(box => box.getAttribute("aria-label") || box.className);
  },

  focused() {
    const element = document.activeElement, style = getComputedStyle(element);
    const seen = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 1;
    return {name: element.id || element.getAttribute("aria-label") || element.tagName, kind: element.tagName, seen};
  },
})
