"""The laboratory: how exact, how dear and how safe each way of computing a scene is."""
