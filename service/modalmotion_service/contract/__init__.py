"""The contract: the OpenAPI file and the pages made from it."""
