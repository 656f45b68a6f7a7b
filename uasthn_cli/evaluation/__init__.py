"""The paper's protocol: estimators over pairs, predictions in a file, tables and figures of it."""
