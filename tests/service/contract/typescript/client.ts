// From a file to its classes and back, by a client that is typed by the interface's document.
import { readFile, writeFile } from "node:fs/promises";
import createClient from "openapi-fetch";
import type { paths } from "./schema.js";

const [baseUrl, source, folder] = process.argv.slice(2);
// Options of a file are written one by one: ?rms=0.5.
const querySerializer = { object: { style: "form", explode: true } } as const;
const api = createClient<paths>({ baseUrl, querySerializer });
// The document describes a file as a string in binary; it is sent as it is.
const octets = (data: Uint8Array) => ({
  body: data as unknown as string,
  bodySerializer: (body: unknown) => body as BodyInit,
  headers: { "Content-Type": "application/octet-stream" },
});

function given<T>(answer: { data?: T; error?: unknown }): T {
  if (answer.data === undefined) throw new Error(JSON.stringify(answer.error));
  return answer.data;
}

// Asked for as a buffer; its type is that of all answers, a job among them.
async function keep(name: string, answer: { data?: unknown; error?: unknown }) {
  const data = new Uint8Array(given(answer) as ArrayBuffer);
  await writeFile(`${folder}/${name}`, data);
  return data;
}

const beat = octets(await readFile(source));
const sequence = given(await api.POST("/v1/sequences", beat));
if (!("id" in sequence)) throw new Error("no sequence");
const path = { sequence_id: sequence.id };
const signature = given(
  await api.POST("/v1/sequences/{sequence_id}/signatures", { params: { path }, body: { modes: 7 } }),
);
if (typeof signature === "string" || !("amplitudes" in signature)) throw new Error("no signature");
const key = signature.key;
if (!key) throw new Error("not stored");
const answer = given(
  await api.POST("/v1/signatures/{key}/classifications", { params: { path: { key } } }),
);
if (!("probabilities" in answer)) throw new Error("no classes");
const binary = { parseAs: "arrayBuffer" } as const;
const rms = { params: { query: { parameters: { rms: 0.5 } } } };
const stream = await keep("beat.mms", await api.POST("/v1/encode", { ...beat, ...rms, ...binary }));
await keep("decoded.npz", await api.POST("/v1/decode", { ...octets(stream), ...binary }));
await keep(
  "reconstruction.npz",
  await api.GET("/v1/signatures/{key}/reconstruction", { params: { path: { key } }, ...binary }),
);
console.log(
  JSON.stringify({
    id: sequence.id,
    amplitudes: signature.amplitudes,
    probabilities: answer.probabilities,
    // What is refused is typed too.
    refusal: (await api.POST("/v1/sequences", octets(new Uint8Array(9)))).error?.code,
  }),
);
