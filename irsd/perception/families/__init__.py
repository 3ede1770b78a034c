"""One adapter per family of models: an opened session and a tokenizer in, a role out."""
