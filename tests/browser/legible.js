// Returns, as sentences, what cannot be read on a page. Drawings that move, such as the marks of calls, come and go.
// The argument is a selector of what a reader scrolls on purpose, such as an editor.
const [scrolled] = arguments;
const SLACK = 2, COVERED = 0.05;
const faults = [];
const name = node => {
    const text = node.textContent.trim().replace(/\s+/g, " ").slice(0, 60);
    return `${node.tagName.toLowerCase()}${node.id && "#" + node.id}.${node.classList} "${text}"`;
};
const isScrolled = node => Boolean(scrolled && node.closest(scrolled));
const seen = node => node.checkVisibility({visibilityProperty: true, opacityProperty: true})
    && !node.closest(".visually_hidden, .moving, .slow, noscript, script, style, option, datalist")
    && !isScrolled(node);
const page = {left: 0, top: 0, right: innerWidth, bottom: innerHeight};

// The part of a node that its ancestors let through.
function window_of(node) {
    let {left, top, right, bottom} = page;
    let isLifted = false; // out of the ancestors up to the next one that has a position
    for (let each = node; each && each !== document.body; each = each.parentElement) {
        const {overflow, position} = getComputedStyle(each);
        const isSkipped = isLifted && position === "static";
        isLifted = position === "absolute" || position === "fixed" || isSkipped;
        if (overflow === "visible" || isSkipped) continue;
        const box = each.getBoundingClientRect();
        left = Math.max(left, box.left); top = Math.max(top, box.top);
        right = Math.min(right, box.right); bottom = Math.min(bottom, box.bottom);
    }
    return {left, top, right, bottom};
}

const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let text; (text = walker.nextNode());) {
    const node = text.parentElement;
    if (!text.data.trim() || !seen(node)) continue;
    if (text.data.includes("`")) faults.push(`a literal backtick in ${name(node)}`);
    const range = document.createRange();
    range.selectNodeContents(text);
    const through = window_of(node);
    const isCut = [...range.getClientRects()].some(box => box.width > 0 && (
        box.left < through.left - SLACK || box.right > through.right + SLACK ||
        box.top < through.top - SLACK || box.bottom > through.bottom + SLACK));
    if (isCut) faults.push(`the text of ${name(node)} is cut off`);
}
for (const node of document.querySelectorAll("html, body, body *")) {
    if (!node.checkVisibility() || node.closest(".visually_hidden, svg") || isScrolled(node)) continue;
    const {overflowX, overflowY} = getComputedStyle(node);
    const scrolls = way => ["auto", "scroll"].includes(way);
    const high = node.scrollHeight > node.clientHeight + 1, wide = node.scrollWidth > node.clientWidth + 1;
    if ((scrolls(overflowY) && high) || (scrolls(overflowX) && wide)) faults.push(`${name(node)} scrolls`);
}
for (const field of document.querySelectorAll("select")) {
    if (!seen(field)) continue;
    const copy = field.cloneNode(true); // as wide as the longest option
    Object.assign(copy.style, {position: "absolute", width: "auto", maxWidth: "none"});
    field.after(copy);
    if (copy.offsetWidth > field.offsetWidth + SLACK) faults.push(`the longest option of select#${field.id} is cut off`);
    copy.remove();
}

const lines = document.querySelectorAll("#calls .lane_lines path");
const names = [...document.querySelectorAll("#calls .lane_names li > :first-child")];
if (lines.length && document.querySelector("#calls").checkVisibility()) {
    const named = names.filter(node => node.textContent.trim() && seen(node));
    if (named.length !== lines.length) faults.push(`${lines.length} lanes have ${named.length} names`);
}

// Labels of the map: they may not cover each other, nor stand on walls or on the edge of the floor.
const STEPS = 12;
const box = node => node.getBoundingClientRect();
function pointsOf({left, top, width, height}) {
    const points = [];
    for (let i = 0.5; i < STEPS; i++) for (let j = 0.5; j < 4; j++) points.push([left + width * i / STEPS, top + height * j / 4]);
    return points;
}
const shareIn = (label, isIn) => { const points = pointsOf(box(label)); return points.filter(isIn).length / points.length; };
const labels = [...document.querySelectorAll("#map .place_names text")].filter(seen);
const floor = document.querySelector("#map .floor");
for (const label of labels) {
    for (const wall of document.querySelectorAll("#map .walls polygon")) {
        const back = wall.getScreenCTM().inverse();
        if (shareIn(label, ([x, y]) => wall.isPointInFill(new DOMPoint(x, y).matrixTransform(back))) > COVERED) faults.push(`the label ${name(label)} stands on a wall`);
    }
    for (const other of labels) {
        const {left, right, top, bottom} = box(other);
        const isIn = ([x, y]) => x > left && x < right && y > top && y < bottom;
        if (other !== label && shareIn(label, isIn) > COVERED) faults.push(`the label ${name(label)} covers ${name(other)}`);
    }
    const {left, right, top, bottom} = box(floor);
    const outside = shareIn(label, ([x, y]) => x < left || x > right || y < top || y > bottom);
    if (outside > COVERED && outside < 1 - COVERED) faults.push(`the label ${name(label)} crosses the edge of the floor`);
}
return faults;
