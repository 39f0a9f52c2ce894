// Shows as many rows of a list as fit, and how many more there are; a button shows all of them. On a
// projector, the count in the head of the list is enough.

import { isProjector, rem, setAttribute, setText } from "./dom.js";
import { plural } from "./words.js";

export class Fitting {
  /** `height` is that of a row in rem; `more` is the button below the list. */
  constructor(list, more, height) {
    this.list = list;
    this.more = more;
    this.height = height;
    this.isAll = false; // whether the list shows all rows
    this.rest = 0; // rows that the server did not send
    this.room = Infinity; // pixels
    more.hidden = isProjector;
    more.onclick = () => this.showAll(!this.isAll);
    new ResizeObserver(([{ target, contentRect }]) => {
      const isFixed = getComputedStyle(target).flexGrow > 0; // on a phone, the page scrolls
      this.room = isFixed ? contentRect.height : Infinity;
      this.update(this.rest);
    }).observe(list.parentElement);
  }

  showAll(isAll) {
    this.isAll = isAll;
    this.update(this.rest);
  }

  /** Hide the rows that do not fit. */
  update(rest) {
    this.rest = rest;
    const rows = [...this.list.children];
    const height = this.height() * rem();
    const room = Math.floor((this.room + 1) / height);
    const isFull = rest > 0 || rows.length > room;
    const most = isFull ? Math.max(1, isProjector ? room : room - 1) : rows.length;
    rows.forEach((row, i) => (row.hidden = !this.isAll && i >= most));
    const hidden = rest + Math.max(0, rows.length - most);
    const isCounted = this.isAll ? rows.length > most : hidden > 0;
    setText(this.more, !isCounted ? "" : this.isAll ? "Show fewer" : `and ${plural(hidden, "more task")}`);
    setAttribute(this.more, "aria-expanded", isCounted ? this.isAll : null);
  }
}
