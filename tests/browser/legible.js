// Returns, as sentences, what cannot be read on a page. Drawings that move, such as the marks of calls, come and go.
const SLACK = 2, COVERED = 0.2;
const faults = [];
const name = node => {
    const text = node.textContent.trim().replace(/\s+/g, " ").slice(0, 60);
    return `${node.tagName.toLowerCase()}${node.id && "#" + node.id}.${node.classList} "${text}"`;
};
const seen = node => node.checkVisibility({visibilityProperty: true, opacityProperty: true})
    && !node.closest(".visually_hidden, .moving, .slow, noscript, script, style, option, datalist");
const page = {left: 0, top: 0, right: innerWidth, bottom: innerHeight};

// The part of a node that its ancestors let through.
function window_of(node) {
    let {left, top, right, bottom} = page;
    for (let each = node; each && each !== document.body; each = each.parentElement) {
        if (getComputedStyle(each).overflow === "visible") continue;
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
    if (!node.checkVisibility() || node.closest(".visually_hidden, svg")) continue;
    const {overflowX, overflowY} = getComputedStyle(node);
    const scrolls = way => ["auto", "scroll"].includes(way);
    const high = node.scrollHeight > node.clientHeight + 1, wide = node.scrollWidth > node.clientWidth + 1;
    if ((scrolls(overflowY) && high) || (scrolls(overflowX) && wide)) faults.push(`${name(node)} scrolls`);
}

const lines = document.querySelectorAll("#calls .lane_lines path");
const names = [...document.querySelectorAll("#calls .lane_names li > :first-child")];
if (lines.length && document.querySelector("#calls").checkVisibility()) {
    const named = names.filter(node => node.textContent.trim() && seen(node));
    if (named.length !== lines.length) faults.push(`${lines.length} lanes have ${named.length} names`);
}

// Labels of the map: they may not cover each other, nor stand on walls.
const box = node => node.getBoundingClientRect();
const share = (a, b) => {
    const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    return width > 0 && height > 0 ? (width * height) / (a.width * a.height) : 0;
};
const labels = [...document.querySelectorAll("#map .place_names text, #map .other_robots text")].filter(seen);
const walls = [...document.querySelectorAll("#map .walls polygon")];
for (const label of labels) {
    for (const wall of walls) {
        if (share(box(label), box(wall)) > COVERED) faults.push(`the label ${name(label)} stands on a wall`);
    }
    for (const other of labels) {
        if (other !== label && share(box(label), box(other)) > COVERED) faults.push(`the label ${name(label)} covers ${name(other)}`);
    }
}
return faults;
