"""The paper's experiments reproduced (``make figures``)."""
