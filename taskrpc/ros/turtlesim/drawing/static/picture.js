// Draws the lines of the pens and the turtles, each on a canvas of its own.

const css = ([red, green, blue]) => `rgb(${red} ${green} ${blue})`;

export class Picture {
  constructor(paper, lines, turtles) {
    this.paper = paper;
    this.lines = lines.getContext("2d");
    this.canvas = turtles;
    this.turtles = turtles.getContext("2d");
    this.hello = null;
    this.state = null;
    this.frame = 0; // the requested animation frame, 0 for none
    new ResizeObserver(() => this.redraw()).observe(paper);
  }

  /** Start with an empty picture; the server sends all tiles again. */
  begin(hello) {
    this.hello = hello;
    this.lines.clearRect(0, 0, hello.size, hello.size);
  }

  setTile({ x, y, runs }) {
    const { tile } = this.hello;
    const image = this.lines.createImageData(tile, tile);
    let pixel = 0;
    for (const [count, color] of runs) {
      if (color) for (let i = pixel; i < pixel + count; i++) image.data.set([...color, 255], 4 * i);
      pixel += count;
    }
    this.lines.putImageData(image, x, y);
  }

  show(state) {
    this.state = state;
    this.paper.style.backgroundColor = css(state.background);
    this.redraw();
  }

  redraw() {
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      if (this.hello && this.state) this.draw();
    });
  }

  /** Draw the turtles with all pixels that the screen has. */
  draw() {
    const side = Math.round(this.paper.clientWidth * devicePixelRatio);
    if (this.canvas.width !== side) this.canvas.width = this.canvas.height = side;
    const { size, pixels_per_metre: scale, outlines } = this.hello;
    this.turtles.setTransform(side / size, 0, 0, side / size, 0, 0);
    this.turtles.clearRect(0, 0, size, size);
    for (const { left, top, theta } of this.state.turtles) {
      this.turtles.save();
      this.turtles.translate(left, top);
      this.turtles.rotate(-theta); // headings are counter-clockwise, and y points down here
      this.turtles.scale(scale, -scale);
      for (const outline of outlines) this.drawPart(outline, 1 / scale);
      this.turtles.restore();
    }
  }

  drawPart([points, fill, edge], width) {
    this.turtles.beginPath();
    for (const point of points) this.turtles.lineTo(...point);
    this.turtles.closePath();
    this.turtles.fillStyle = css(fill);
    this.turtles.strokeStyle = css(edge);
    this.turtles.lineWidth = width;
    this.turtles.fill();
    this.turtles.stroke();
  }
}
