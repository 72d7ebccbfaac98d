// An issuer of access tokens as JWT: `node issuer.mjs PORT`, its keys and client in the environment.

import Provider from "oidc-provider";

const [port] = process.argv.slice(2);
const { KEYS, CLIENT, SECRET, ALGORITHM } = process.env;
const issuer = `http://127.0.0.1:${port}`;

const provider = new Provider(issuer, {
  jwks: { keys: JSON.parse(KEYS) },
  clients: [{
    client_id: CLIENT, client_secret: SECRET, grant_types: ["client_credentials"], redirect_uris: [], response_types: [],
    id_token_signed_response_alg: ALGORITHM,
  }],
  features: {
    clientCredentials: { enabled: true },
    devInteractions: { enabled: false },
    resourceIndicators: {
      enabled: true,
      // The audience of what is asked for: urn:modalmotion is for modalmotion.
      getResourceServerInfo: (_context, resource) => ({
        audience: resource.slice("urn:".length),
        scope: "modalmotion:read modalmotion:write",
        accessTokenFormat: "jwt",
        accessTokenTTL: 600,
        jwt: { sign: { alg: ALGORITHM } },
      }),
    },
  },
});

provider.listen(Number(port), "127.0.0.1");
