// Keeps the student's files in the browser, one entry for each file of each lab.

const key = (lab, version, name) => `taskrpc lab ${lab} ${version} ${name}`;

/** The files of one lab in one version ("rclpy" or "async"): what the student wrote, else the starter. */
export class Files {
  constructor(lab, version) {
    this.lab = lab;
    this.version = version;
    this.starters = version === "async" ? lab.async_files : lab.files;
    this.unsaved = new Map(); // where the browser stores nothing
  }

  get names() {
    return this.starters.map(({ name }) => name);
  }

  get programs() {
    return this.starters.filter(({ program }) => program).map(({ name }) => name);
  }

  starter(name) {
    return this.starters.find((file) => file.name === name).text;
  }

  text(name) {
    try {
      return this.unsaved.get(name) ?? localStorage.getItem(key(this.lab.number, this.version, name)) ?? this.starter(name);
    } catch {
      return this.unsaved.get(name) ?? this.starter(name);
    }
  }

  /** Keep a text; returns whether the browser will have it after a reload. */
  save(name, text) {
    try {
      localStorage.setItem(key(this.lab.number, this.version, name), text);
      this.unsaved.delete(name);
      return true;
    } catch {
      this.unsaved.set(name, text);
      return false;
    }
  }

  is_changed(name) {
    return this.text(name) !== this.starter(name);
  }

  reset() {
    for (const name of this.names) {
      this.unsaved.delete(name);
      try {
        localStorage.removeItem(key(this.lab.number, this.version, name));
      } catch { /* it stored nothing */ }
    }
  }

  all() {
    return Object.fromEntries(this.names.map((name) => [name, this.text(name)]));
  }
}
