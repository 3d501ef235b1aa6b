// OpenAI-compatible server of one GGUF model on loopback, with llama.cpp (package node-llama-cpp).
//
// Run it in a folder of its own, where `npm install node-llama-cpp` was run:
//     node live_model.mjs MODEL.gguf 8123
// It answers POST /v1/chat/completions. With `response_format` it decodes by the JSON schema.
import http from "node:http";
import {getLlama, LlamaChatSession} from "node-llama-cpp";

const CONTEXT = 16384; // tokens of prompt and answer
const LONGEST = 400; // tokens of an answer; a longer one ends with `finish_reason: length`
const LARGEST = 5_000_000; // bytes of a request

const [path, port] = process.argv.slice(2);
const llama = await getLlama({gpu: false, build: "never"});
const model = await llama.loadModel({modelPath: path});
const context = await model.createContext({contextSize: CONTEXT, threads: 2, flashAttention: true});

const asText = (content) =>
    typeof content === "string" ? content : content.map((part) => part.text ?? "").join("\n");

async function answer(asked) {
    const sequence = context.getSequence();
    try {
        const session = new LlamaChatSession({contextSequence: sequence});
        const messages = asked.messages.map(({role, content}) => ({role, text: asText(content)}));
        const last = messages.pop();
        session.setChatHistory(messages.map(({role, text}) =>
            role === "assistant" ? {type: "model", response: [text]} : {type: role, text}));
        const schema = asked.response_format?.json_schema?.schema;
        const grammar = schema && (await llama.createGrammarForJsonSchema(schema));
        const maxTokens = Math.min(asked.max_tokens ?? LONGEST, LONGEST);
        const made = await session.promptWithMeta(last.text, {maxTokens, grammar, temperature: 0});
        const cut = made.stopReason === "maxTokens";
        return {
            id: "1", object: "chat.completion", created: Math.floor(Date.now() / 1000), model: "gguf",
            choices: [{index: 0, message: {role: "assistant", content: made.responseText},
                finish_reason: cut ? "length" : "stop"}],
            usage: {prompt_tokens: 0, completion_tokens: 0, total_tokens: 0},
        };
    } finally {
        sequence.dispose();
    }
}

http.createServer((request, response) => {
    let body = "";
    request.on("data", (part) => {
        body += part;
        if (body.length > LARGEST) request.destroy();
    });
    request.on("end", async () => {
        let status = 200, document;
        try {
            document = await answer(JSON.parse(body));
        } catch (error) {
            [status, document] = [400, {error: {message: String(error)}}];
        }
        response.writeHead(status, {"Content-Type": "application/json"});
        response.end(JSON.stringify(document));
    });
}).listen(Number(port), "127.0.0.1");
