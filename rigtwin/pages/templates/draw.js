// Draws every figure of the page: in the colours of the page, as wide as its place, and anew when either changes.
const fill = {};  // by a figure's name: what the page's own script puts into it before it is drawn
const draw = (() => {
  const onDark = {{ on_dark }};
  const dark = matchMedia("screen and (prefers-color-scheme: dark)"), paper = matchMedia("print");
  const sheet = {width: 680, highest: 460};  // px; a sheet is narrower than a window and holds more than a figure
  const narrow = 520;  // px; below, a figure has smaller letters and margins
  let printed = false;

  const read = name => {
    const text = document.getElementById(name + "-figure").textContent;
    const inDark = colour => onDark[colour.toLowerCase()] || colour;
    return JSON.parse(dark.matches && !printed ? text.replace(/#[0-9a-f]{6}\b/gi, inDark) : text);
  };
  const arrange = (layout, width) => {
    layout.width = width;
    const shrunk = printed && layout.height > sheet.highest;
    if (shrunk) layout.height = sheet.highest;
    if (width >= narrow && !shrunk) return;
    const size = shrunk ? 10 : 12;
    layout.font = {size};
    layout.margin = {...layout.margin, ...(shrunk ? {} : {l: 48, r: 10})};
    for (const key of Object.keys(layout).filter(key => /^[xy]axis/.test(key))) {
      layout[key] = {...layout[key], nticks: layout[key].nticks || 6, title: {...layout[key].title, font: {size: shrunk ? 8 : size}}};
    }
  };
  const drawOne = name => {
    const place = document.getElementById(name), figure = read(name);
    if (fill[name]) fill[name](figure);
    arrange(figure.layout, printed ? sheet.width : place.clientWidth);
    place.style.height = figure.layout.height + "px";
    Plotly.react(place, figure.data, figure.layout, {displaylogo: false, displayModeBar: false});
  };
  const drawAll = () => document.querySelectorAll(".figure").forEach(place => drawOne(place.id));
  // What scrolls in its box can be scrolled by the keyboard.
  const reach = () => document.querySelectorAll(".table, .wide").forEach(box => {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0; else box.removeAttribute("tabindex");
  });
  const onto = isPaper => () => { printed = isPaper; drawAll(); };

  addEventListener("DOMContentLoaded", () => { drawAll(); reach(); });
  let width = innerWidth;
  addEventListener("resize", () => {
    if (printed || width === innerWidth) return;
    width = innerWidth;
    drawAll();
    reach();
  });
  addEventListener("beforeprint", onto(true));
  addEventListener("afterprint", onto(false));
  paper.addEventListener("change", () => onto(paper.matches)());
  dark.addEventListener("change", drawAll);
  document.addEventListener("toggle", reach, true);
  return drawOne;
})();
