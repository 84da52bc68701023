"""Nodes and links: how storeys are joined and what drives them."""
