"""Networks that turn camera images and a route map into the logits of a bird's-eye view."""
