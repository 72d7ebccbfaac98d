// Calls of the service: the key is typed in and kept in memory, jobs are waited for.

export class Refused extends Error {
  constructor(status, problem) {
    super([problem.detail || problem.title || `The service answered ${status}.`, problem.remedy].filter(Boolean).join(" "));
    this.status = status;
  }
}

// Where a proxy has the service under a path: what stands before the folder of this script.
export const BASE = import.meta.url.startsWith("http") ? new URL("..", import.meta.url).pathname.slice(0, -1) : "";

let key = null;
// One question for all calls that wait for its answer.
let question = null;

export class Service {
  constructor(askKey) {
    this.askKey = askKey;
  }

  // A job's result is fetched from its link.
  async call(path, { method = "GET", accept, body, type, isJob } = {}) {
    for (;;) {
      const used = key;
      const headers = { Accept: accept || "application/json" };
      if (key) headers.Authorization = `Bearer ${key}`;
      if (type) headers["Content-Type"] = type;
      if (isJob) headers.Prefer = "respond-async";
      const answer = await fetch(BASE + path, { method, headers, body, credentials: "omit" });
      if (answer.status === 401) {
        await this.anotherKey(used);
        continue;
      }
      if (answer.status === 202) return this.result(answer.headers.get("Location"), accept);
      if (!answer.ok) throw new Refused(answer.status, await answer.json().catch(() => ({})));
      return answer;
    }
  }

  // A key in place of one that was refused, unless it has been replaced meanwhile.
  async anotherKey(used) {
    if (key !== used) return;
    question ||= this.askKey(key !== null).finally(() => (question = null));
    key = await question;
  }

  async result(location, accept) {
    for (;;) {
      await new Promise((done) => setTimeout(done, 700));
      const job = await (await this.call(location.replace(BASE, ""))).json();
      if (this.onJob) this.onJob(job);
      if (job.state === "succeeded") return this.call(job.result, { accept });
      if (job.state !== "queued" && job.state !== "running")
        throw new Refused(500, job.error || { detail: `The job was ${job.state}.` });
    }
  }

  async json(path, options) {
    return (await this.call(path, options)).json();
  }

  // XMLHttpRequest, for only it tells how much has been sent.
  upload(file, onProgress, path) {
    return new Promise((resolve, reject) => {
      const send = () => {
        const used = key;
        const request = new XMLHttpRequest();
        request.open("POST", BASE + path);
        if (key) request.setRequestHeader("Authorization", `Bearer ${key}`);
        request.setRequestHeader("Content-Type", "application/octet-stream");
        request.responseType = "json";
        request.upload.onprogress = (event) => event.lengthComputable && onProgress(event.loaded / event.total);
        request.onerror = () => reject(new Error("The service cannot be reached."));
        request.onload = async () => {
          if (request.status === 401) {
            await this.anotherKey(used);
            send();
          } else if (request.status === 202) {
            this.result(request.getResponseHeader("Location")).then((answer) => resolve(answer.json()), reject);
          } else if (request.status >= 400) {
            reject(new Refused(request.status, request.response || {}));
          } else resolve(request.response);
        };
        request.send(file);
      };
      send();
    });
  }
}

export function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
