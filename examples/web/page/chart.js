// The chart of error against time, with logarithmic axes: a dot for each half second.

const TIMES = [0.01, 100]; // ms
const ERRORS = [0.01, 1000]; // mm
const MARGIN = { left: 58, right: 12, top: 12, bottom: 44 };
const KEPT = 60;

export class Chart {
  constructor(canvas) {
    [this.canvas, this.context, this.dots, this.name] = [canvas, canvas.getContext("2d"), [], ""];
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.draw();
  }

  clear() {
    this.dots = [];
    this.draw();
  }

  // The setting that the following dots belong to.
  label(name) {
    this.name = name;
  }

  add(milliseconds, error) {
    const last = this.dots.at(-1);
    if (last && last.error === error) return; // no new comparison
    this.dots.push({ milliseconds, error, name: this.name });
    this.dots = this.dots.slice(-KEPT);
    this.draw();
  }

  place([low, high], value, from, to) {
    const share = Math.log(Math.max(value, low) / low) / Math.log(high / low);
    return from + Math.min(share, 1) * (to - from);
  }

  draw() {
    const { canvas, context: c } = this;
    const style = getComputedStyle(canvas);
    const [ink, faint, accent] = [style.color, style.borderTopColor, style.accentColor];
    const [left, right] = [MARGIN.left, canvas.width - MARGIN.right];
    const [top, bottom] = [MARGIN.top, canvas.height - MARGIN.bottom];
    const x = (ms) => this.place(TIMES, ms, left, right);
    const y = (mm) => this.place(ERRORS, mm, bottom, top);
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.font = "20px system-ui, sans-serif";
    [c.lineWidth, c.fillStyle, c.strokeStyle] = [1, ink, ink];
    c.globalAlpha = 0.2;
    c.beginPath();
    for (let ms = TIMES[0]; ms <= TIMES[1]; ms *= 10) c.moveTo(x(ms), top), c.lineTo(x(ms), bottom);
    for (let mm = ERRORS[0]; mm <= ERRORS[1]; mm *= 10) c.moveTo(left, y(mm)), c.lineTo(right, y(mm));
    c.stroke();
    c.globalAlpha = 0.8;
    c.textAlign = "center";
    for (let ms = 0.1; ms <= 10.5; ms *= 10) c.fillText(`${Number(ms.toPrecision(1))} ms`, x(ms), bottom + 26);
    c.textAlign = "right";
    for (let mm = 0.1; mm <= 105; mm *= 10) c.fillText(`${Number(mm.toPrecision(1))}`, left - 8, y(mm) + 7);
    c.fillText("mm", left - 8, top + 14);
    this.dots.forEach((dot, k) => {
      const newest = k === this.dots.length - 1;
      c.globalAlpha = newest ? 1 : 0.15 + 0.5 * (k / this.dots.length);
      c.fillStyle = dot.name === this.name ? accent : faint;
      c.beginPath();
      c.arc(x(dot.milliseconds), y(dot.error), newest ? 8 : 5, 0, 7);
      c.fill();
    });
    c.globalAlpha = 1;
  }
}
